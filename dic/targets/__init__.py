"""Detection of calibration targets in an image: the points of a target in pixels and in millimetres."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
