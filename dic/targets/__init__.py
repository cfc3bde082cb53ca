"""Detection of calibration targets in an image: the points of a target in pixels and in millimetres."""
