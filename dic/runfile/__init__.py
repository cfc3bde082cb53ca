"""The layout and the reader of run files, which contain the images and the device readings of a test."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
