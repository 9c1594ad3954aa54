"""Compact models as files for other programs."""
