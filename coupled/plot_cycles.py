"""The old place of figures of branches of cycles, kept for scripts; they are in `coupled.plot.cycles`."""

from .plot.cycles import plot_branch

__all__ = ["plot_branch"]
