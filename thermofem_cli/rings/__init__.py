"""Commands on a ring: modes, traces, maps, sweeps, identification, linearization, co-simulation, the page."""
