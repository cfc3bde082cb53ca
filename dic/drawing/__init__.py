"""Writes a page on which a person draws regions, cracks and gauges over an image, offline in any browser."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
