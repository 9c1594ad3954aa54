"""Small models of one ring or several, computed from the system of the FEM, each with a bound of its error."""
