"""Estimation of the parameters of a ring and its thermal model from measured or simulated drop traces."""
