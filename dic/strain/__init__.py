"""Compute strain from displacements, with standard deviations of the strain."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
