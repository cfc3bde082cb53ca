"""The processing of images or of a run file: calibrate, correlate, compute strain, correct, write files."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
