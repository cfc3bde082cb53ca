"""Repeat the numerical assessment of the calibration from the paper of Helm and Deaner."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
