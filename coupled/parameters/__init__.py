"""Published parameter sets, one file a paper, every number with its unit and source."""
