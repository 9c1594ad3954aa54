"""Settled cycles of a ring: solved for, followed, and differentiated."""
