"""Commands on heat: geometry to training data."""
