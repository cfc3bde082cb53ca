"""Find calibration targets in an image: their points in pixels and in millimetres."""
