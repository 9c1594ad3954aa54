"""Fixed points of a ring with its thermal model: their number and values, stability, and bifurcations."""
