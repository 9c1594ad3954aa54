"""Small models computed from the system of the FEM, each with a bound of its error."""
