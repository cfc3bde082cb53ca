"""Correlation of images: displacements between a reference image and deformed images."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
