"""Several rings on one chip as one certified model."""
