"""The strain measures, one module for each.

A new measure is a module with a `MEASURE`, and its name in `_MODULES`.
"""

from importlib import import_module

from dic.strain.measures.measure import Measure

_MODULES = ("green_lagrange", "small", "hencky")

MEASURES: dict[str, Measure] = {
    found.name: found for found in (import_module(f"{__name__}.{module}").MEASURE for module in _MODULES)
}
"""Each strain measure by its name."""
