"""Writes reports as single HTML files; the report on runs compares them with Helm and Deaner's paper."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
