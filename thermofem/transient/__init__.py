"""Full-order transients: in closed form, stepped, with stages for k(T) and c_p(T), and over windows of time."""

from .integration import integrate, integrate_periodic
from .trajectory import Ledger

__all__ = ["Ledger", "integrate", "integrate_periodic"]
