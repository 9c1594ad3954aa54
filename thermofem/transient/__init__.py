"""Full-order transients: in closed form, by time stepping, with k(T) and c_p(T), and over successive time windows."""

from .integration import Ledger, integrate, integrate_periodic

__all__ = ["Ledger", "integrate", "integrate_periodic"]
