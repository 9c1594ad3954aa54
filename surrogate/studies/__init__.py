"""Questions to a family of geometries: design, calibration and uncertainty."""
