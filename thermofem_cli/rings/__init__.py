"""Commands on a ring with light: traces, maps, stability, co-simulation."""
