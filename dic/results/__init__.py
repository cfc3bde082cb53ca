"""The output of results: HDF5 result files, CSV tables, and maps as pictures."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
