"""Ring and heat trained on drop traces, measured or simulated."""
