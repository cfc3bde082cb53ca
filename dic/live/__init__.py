"""Gauges while a test runs: the strain in each frame, its standard deviation, and whether it is valid."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
