"""The strain measures, one module for each.

A new measure is a module with a `MEASURE`, and its name in `_MODULES`.
"""

from collections.abc import Iterator, Mapping
from functools import cache
from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from dic.strain.measures.measure import Measure

_MODULES = {"green-lagrange": "green_lagrange", "small": "small", "hencky": "hencky"}


@cache
def _measure(module: str) -> "Measure":
    found: Measure = import_module(f"{__name__}.{module}").MEASURE
    return found


class _Measures(Mapping[str, "Measure"]):
    """Each strain measure by its name; its module is imported when the measure is used."""

    def __getitem__(self, name: str) -> "Measure":
        return _measure(_MODULES[name])

    def __iter__(self) -> Iterator[str]:
        return iter(_MODULES)

    def __len__(self) -> int:
        return len(_MODULES)


MEASURES = _Measures()
