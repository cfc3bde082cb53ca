"""Calibration of a camera: maps from pixels in the image to millimetres on the plane of a grid."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
