"""Pictures of measured fields: maps over the image, contact sheets of a series, and their scales."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
