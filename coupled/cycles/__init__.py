"""Periodic orbits of a self-pulsing ring: shooting, continuation in a parameter, and derivatives by parameters."""
