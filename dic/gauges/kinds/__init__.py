"""The kinds of gauges, one module for each.

A new kind is a module with a subclass of `Gauge`, and its class in `_KINDS`. Files, options, readings, tables
and pictures take the kinds from `GAUGES`. Only the page of `dic draw` must be taught to draw it.
"""

from collections.abc import Mapping

from dic.gauges.declared import Gauge
from dic.gauges.kinds.area import StrainGauge
from dic.gauges.kinds.cut import LineCut
from dic.gauges.kinds.extensometer import Extensometer
from dic.gauges.kinds.point import PointGauge
from dic.gauges.kinds.transverse import TransverseExtensometer

__all__ = ["GAUGES", "Extensometer", "LineCut", "PointGauge", "StrainGauge", "TransverseExtensometer"]

_KINDS: tuple[type[Gauge], ...] = (Extensometer, TransverseExtensometer, StrainGauge, LineCut, PointGauge)

GAUGES: Mapping[str, type[Gauge]] = {kind.kind: kind for kind in _KINDS}
"""The class of each kind of gauge, by its name in files and options."""
