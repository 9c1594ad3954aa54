"""Full-order transients: the integrator, its stages for k(T) and c_p(T), and the field over windows of time."""

from .integration import integrate, integrate_periodic
from .trajectory import Ledger

__all__ = ["Ledger", "integrate", "integrate_periodic"]
