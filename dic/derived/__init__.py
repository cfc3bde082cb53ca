"""What is made from results: readings of gauges, tables, exports, comparisons and animations."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
