"""Compares the noise, resolution and error of many settings on the user's own images."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
