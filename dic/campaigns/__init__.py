"""Compares the tensile tests of several specimens: values, mean, scatter, outliers, planar anisotropy."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
