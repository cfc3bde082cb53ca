"""Reads the tables that testing machines record, and joins their readings to images."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
