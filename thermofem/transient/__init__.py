"""Full-order transients: the integrator, its stages for k(T) and c_p(T), and the field over windows of time."""

from .integration import Ledger, integrate, integrate_periodic

__all__ = ["Ledger", "integrate", "integrate_periodic"]
