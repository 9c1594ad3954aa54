"""The old place of figures of circuits, kept for scripts that import it; they are in `coupled.plot.circuit`."""

from .plot.circuit import plot_circuit, plot_ports, plot_rings

__all__ = ["plot_circuit", "plot_ports", "plot_rings"]
