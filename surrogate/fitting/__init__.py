"""Models fitted to temperatures: measured ones, or those of the FEM."""
