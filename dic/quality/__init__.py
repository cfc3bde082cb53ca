"""The quality of an image for the measurement: speckles, noise, light and focus."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
