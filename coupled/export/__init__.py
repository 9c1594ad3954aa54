"""Rings whole, with light, carriers and heat, for circuit and system simulators."""
