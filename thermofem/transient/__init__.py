"""Full-order transients: in closed form, by time stepping, with k(T) and c_p(T), and over successive time windows."""

from .integration import integrate, integrate_periodic

__all__ = ["integrate", "integrate_periodic"]
