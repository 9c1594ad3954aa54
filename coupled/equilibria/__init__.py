"""Fixed points of ring and heat: where they are, whether they are stable, and where that changes."""
