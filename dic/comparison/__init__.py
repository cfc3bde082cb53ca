"""Reads result files of other correlation programs, and compares them with a measurement of offaxis."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
