"""Parameters from slow sweeps of the transmission."""
