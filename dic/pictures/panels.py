"""The content of a map: the values of a measurement, their places in the image, and their scale."""

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dic.errors import CorrelationError
from dic.out_of_plane.correction import Correction
from dic.pictures.places import PointCells, places_of
from dic.pictures.settings import QUANTITIES, MapSettings
from dic.strain.measurement import Measurement
from dic.strain.strain import StrainField, strain_field
from dic.typing import Float

MICRO = 1e6
PERCENT_FROM = 1e4
"""Strains are shown in % if the largest of them is at least this many µε, which is 1 %."""
_PERCENTILES = (1.0, 99.0)
"""The colour scale spans these percentiles of the values, so that single extreme values do not widen it."""

_LEAST_SPREAD = 1e-3
"""Least range of a colour scale, as a fraction of its larger absolute end."""
_LEAST_RANGE = 1e-9
"""Least range of a colour scale for an image without any motion, where all values are zero."""

_STRAIN_NAMES = {"exx": "εxx", "eyy": "εyy", "exy": "εxy"}


@dataclass(frozen=True)
class Panel:
    """The values of one map."""

    quantity: str
    """One of `QUANTITIES`."""
    name: str
    """Title of the map, without the unit."""
    unit: str
    values: Float
    """Shape (rows, columns). Values at the points; NaN at a point without a value."""
    reach: tuple[float, float] | None = None
    """The lowest and the highest value of all images that share the colour bar; None for those of `values`.
    """
    kind: str = ""
    """Kind of the strain: "raw", "calibrated" or "corrected"; "" for a displacement."""

    @property
    def title(self) -> str:
        """Title of the map: the name and the unit of the quantity."""
        return f"{self.name}, {self.unit}"

    @property
    def ends(self) -> tuple[float, float]:
        """The lowest and the highest value; `values` must have one."""
        return self.reach or (float(np.nanmin(self.values)), float(np.nanmax(self.values)))

    @property
    def span(self) -> tuple[float, float] | None:
        """The 1st and the 99th percentile of the values; None if there are no values."""
        known = self.values[np.isfinite(self.values)]
        if not known.size:
            return None
        low, high = np.percentile(known, _PERCENTILES)
        return float(low), float(high)


def common_name(panels: Sequence[Panel]) -> tuple[str, bool]:
    """Return the name of one quantity in several images, and whether the images show different kinds.

    The name contains the kind of strain if all images show the same kind. If the kinds differ, for example
    because the correction of one image was declined, each map must name its own kind.
    """
    first = panels[0]
    if len({panel.kind for panel in panels}) == 1:
        return first.name, False
    return _STRAIN_NAMES[first.quantity], True


@dataclass(frozen=True)
class Maps:
    """All maps of one image: the values, and the places of the points in the picture."""

    panels: tuple[Panel, ...]
    places: PointCells

    def only(self, quantities: Collection[str]) -> "Maps":
        """Return the maps of some of the quantities."""
        return replace(self, panels=tuple(panel for panel in self.panels if panel.quantity in quantities))


def maps_of(measurement: Measurement, settings: MapSettings, correction: Correction | None = None) -> Maps:
    """Return the maps of a measurement, of the kind of values that the settings choose.

    Raises `CorrelationError` if the kind needs a calibration and there is none, or axes in mm cannot be
    drawn.
    """
    panels = {panel.quantity: panel for panel in _panels(measurement, correction, settings.kind)}
    chosen = tuple(panels[quantity] for quantity in QUANTITIES if quantity in settings.quantities)
    return Maps(chosen, places_of(measurement, settings))


def _panels(measurement: Measurement, correction: Correction | None, wanted: str) -> Iterable[Panel]:
    MapSettings.require_calibrated_values(wanted, calibrated=measurement.calibrated is not None)
    corrected = None if correction is None or correction.declined is not None else correction
    kind = _kind_of(measurement, corrected) if wanted == "best" else wanted
    shown, strain = measurement.raw, None
    if kind == "corrected" and corrected is not None:
        shown, strain = corrected.displacement, corrected.strain
    elif kind != "raw" and measurement.calibrated is not None:
        shown, strain = measurement.calibrated, measurement.strain
    elif measurement.calibrated is None:
        strain = measurement.strain
    # An image that was not corrected has no corrected values.
    present = kind != "corrected" or corrected is not None
    vector = np.where(measurement.field.converged[..., None] & present, shown.vector, np.nan)
    x, y = ("U", "V") if shown.unit == "mm" else ("u", "v")
    yield Panel("u", f"{x} to the right", shown.unit, vector[..., 0])
    yield Panel("v", f"{y} upwards", shown.unit, vector[..., 1])
    strain = _raw_strain(measurement) if strain is None else strain
    for quantity, name in _STRAIN_NAMES.items():
        values = np.where(present, getattr(strain, quantity), np.nan) * MICRO
        yield Panel(quantity, f"{name} {kind}", "µε", values, kind=kind)


def _kind_of(measurement: Measurement, corrected: Correction | None) -> str:
    """Return the best kind of values that an image has."""
    if corrected is not None:
        return "corrected"
    return "calibrated" if measurement.calibrated is not None else "raw"


def _raw_strain(measurement: Measurement) -> StrainField:
    """Return the local strain from displacements in px of an image that also has calibrated ones."""
    if measurement.strain_settings.source == "shape" and measurement.raw.gradient is None:
        raise CorrelationError(
            measurement.label,
            "draw raw strain",
            "strain that is fitted to windows of points",
            "strain from shape functions, whose gradients a result file does not hold",
            "compute it anew with `dic strain --strain-from fit`, or leave out the kind raw",
        )
    return strain_field(measurement.raw, measurement.strain_settings)


Scale = Mapping[str, tuple[float, float]]
"""Lower and upper end of the colour scale of each quantity."""


def widened(scale: Scale, maps: Maps) -> Scale:
    """Return a scale widened to span the 1st to the 99th percentile of the maps of a further image."""
    ends = dict(scale)
    for panel in maps.panels:
        if (span := panel.span) is not None:
            low, high = ends.get(panel.quantity, span)
            ends[panel.quantity] = min(low, span[0]), max(high, span[1])
    return ends


def finished(scale: Scale, settings: MapSettings) -> Scale:
    """Return the final scale: symmetric if the colours diverge, and with the limits that the user gave."""
    ends = {quantity: _spread(*span) for quantity, span in scale.items()}
    if settings.colours == "diverging":
        ends = {quantity: _symmetric(*span) for quantity, span in ends.items()}
    return ends | dict(settings.limits)


def _spread(low: float, high: float) -> tuple[float, float]:
    """Return the ends of a scale, moved apart if they differ by little more than rounding errors."""
    least = max(_LEAST_SPREAD * max(abs(low), abs(high)), _LEAST_RANGE)
    if high - low >= least:
        return low, high
    return (low + high - least) / 2, (low + high + least) / 2


def _symmetric(low: float, high: float) -> tuple[float, float]:
    reach = max(abs(low), abs(high))
    return -reach, reach


def scale_of(several: Iterable[Maps], settings: MapSettings) -> Scale:
    """Return one scale for the maps of one or several images.

    The scale spans the 1st to the 99th percentile of each image, unless `settings.limits` gives its ends.
    With diverging colours the scale is symmetric about zero.
    """
    scale: Scale = {}
    for maps in several:
        scale = widened(scale, maps)
    return finished(scale, settings)


def in_readable_unit(panels: Sequence[Panel], scale: Scale) -> tuple[list[Panel], Scale]:
    """Return panels and their scale, with strains in % instead of µε if their scale reaches 1 %."""
    large = {
        panel.quantity
        for panel in panels
        if panel.unit == "µε" and max(map(abs, scale.get(panel.quantity, (0.0,)))) >= PERCENT_FROM
    }
    shown = [
        replace(
            panel,
            unit="%",
            values=panel.values / PERCENT_FROM,
            reach=None
            if panel.reach is None
            else (panel.reach[0] / PERCENT_FROM, panel.reach[1] / PERCENT_FROM),
        )
        if panel.quantity in large
        else panel
        for panel in panels
    ]
    ends = {
        quantity: (low / PERCENT_FROM, high / PERCENT_FROM) if quantity in large else (low, high)
        for quantity, (low, high) in scale.items()
    }
    return shown, ends


def map_scale(
    measurements: Sequence[Measurement],
    settings: MapSettings | None = None,
    corrections: Sequence[Correction | None] = (),
) -> Scale:
    """Return one scale for the maps of a series, for `write_maps`.

    Parameters
    ----------
    measurements : sequence of Measurement
    settings : MapSettings, optional
    corrections : sequence of Correction or None, optional
        Corrections of the measurements, in their order.

    Returns
    -------
    dict of str to (float, float)
        Lower and upper end of each quantity: px or mm for displacement, µε for strain.
    """
    settings = settings or MapSettings()
    given = list(corrections) or [None] * len(measurements)
    pairs = zip(measurements, given, strict=True)
    return scale_of((maps_of(each, settings, correction) for each, correction in pairs), settings)
