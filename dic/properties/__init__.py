"""Material properties from the record of a tensile test: elastic slope, yield, strength, hardening."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
