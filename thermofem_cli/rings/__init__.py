"""Commands on a ring: modes, traces, maps, stability, sweeps, identification, linearization, the page, co-simulation."""
