"""Lifetimes of the free carriers, and their measurement by pump and probe."""
