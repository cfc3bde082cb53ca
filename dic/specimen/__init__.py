"""Find the specimen in an image: the surface with speckles that is worth measuring."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
