"""Linear algebra of the heat equation: factorization, rational Krylov spaces, poles in closed form; no models."""
