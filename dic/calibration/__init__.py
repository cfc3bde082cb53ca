"""Calibration of a camera: maps from pixels in the image to millimetres on the plane of a grid."""
