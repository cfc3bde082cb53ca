"""A small measurement to try at once: images, mask, the machine's record, and the true strains."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
