"""Writes the displacement and strain fields of results in the formats of other programs, image by image."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
