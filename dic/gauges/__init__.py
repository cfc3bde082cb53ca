"""Virtual gauges in a displacement field: extensometers, areas, line cuts and points, read in each image."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
