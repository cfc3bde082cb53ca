"""Calibration targets: found in an image, as points in pixels and millimetres."""
