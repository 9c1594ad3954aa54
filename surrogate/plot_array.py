"""The old place of figures of arrays, kept for scripts that import it; they are in `surrogate.plot`."""

from .plot import plot_crosstalk, plot_time_scales

__all__ = ["plot_crosstalk", "plot_time_scales"]
