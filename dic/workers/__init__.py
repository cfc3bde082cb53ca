"""Workers that run functions: threads, processes and other computers, each as a Python executor."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
