"""Corrections for the false strain that appears when a specimen moves out of the grid's plane."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
