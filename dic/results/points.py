"""All values at the points of an image, which become the columns of tables and the fields of exports."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dic.correlation.status import Status
from dic.out_of_plane.correction import Correction
from dic.strain.measurement import Measurement
from dic.strain.strain import IMAGES_KEYS, STRAIN_KEYS, StrainField
from dic.typing import Mask

CORRECTED, RAW = "corrected_", "raw_"
"""Beginnings of the names of corrected values, and of raw strains beside calibrated strains."""


@dataclass(frozen=True)
class PointValues:
    """All values at the points of an image, under the names that are used in files."""

    label: str
    """The path of the image file, or the run's step to which the image belongs."""
    x_px: NDArray[Any]
    """Shape (columns,)."""
    y_px: NDArray[Any]
    """Shape (rows,)."""
    active: Mask
    """Shape (rows, columns). True for the points of the region."""
    values: Mapping[str, NDArray[Any]]
    """Each of shape (rows, columns). Numbers at the points; NaN at a point without a value. The end of a name
    gives the unit: `_px`, `_mm` or `_deg`; other values have no unit. `status` contains the numbers of
    `Status`. `valid` is 1 if the calibrated displacement of the point is not extrapolated. `docs/results.md`
    explains the names.
    """
    strain_kind: str
    """Kind of the strains `exx` …: "raw" or "calibrated". The strains `raw_exx` … are always raw."""
    measurement: Measurement
    """Some kinds of files take further values from it."""

    @classmethod
    def of(
        cls, measurement: Measurement, correction: Correction | None = None, *, raw_strain: bool = False
    ) -> "PointValues":
        """Return the values at a measurement's points, with corrected values if a correction was applied.

        If `raw_strain` is True, the values also contain the raw local strains `raw_exx` …, which are computed
        from the displacements if the strains `exx` … are calibrated.
        """
        field = measurement.field
        values = dict(_values(measurement))
        if raw_strain:
            raw = strain_values(measurement.raw_strain())
            values |= {f"{RAW}{name}": value for name, value in raw.items()}
        if correction is not None and correction.declined is None:
            position, vector = correction.displacement.position, correction.displacement.vector
            for k, axis in enumerate("XY"):
                values[f"{CORRECTED}{axis}_mm"] = position[..., k]
            for k, axis in enumerate("UV"):
                values[f"{CORRECTED}{axis}_mm"] = vector[..., k]
            values[f"{CORRECTED}valid"] = correction.displacement.valid.astype(np.uint8)
            values |= {
                f"{CORRECTED}{name}": value for name, value in strain_values(correction.strain).items()
            }
        kind = "raw" if measurement.calibrated is None else "calibrated"
        return cls(measurement.label, field.x_px, field.y_px, field.active, values, kind, measurement)

    @property
    def converged(self) -> Mask:
        """True for the points with a displacement, shape (rows, columns)."""
        return np.asarray(self.values["status"] == Status.CONVERGED) & self.active


def strain_values(strain: StrainField) -> dict[str, NDArray[Any]]:
    """Return the local strains and their standard deviations, keyed by name; unknown values are left out."""
    names = [*STRAIN_KEYS, *(name for name in IMAGES_KEYS if getattr(strain, name) is not None)]
    return {name: getattr(strain, name) for name in names}


def _values(measurement: Measurement) -> Iterator[tuple[str, NDArray[Any]]]:
    field, calibrated = measurement.field, measurement.calibrated
    for name in ("u_px", "v_px", "std_u_px", "std_v_px", "zncc"):
        yield name, getattr(field, name)
    yield "status", field.status
    if calibrated is not None:
        for pair, numbers in (("XY", calibrated.position), ("UV", calibrated.vector)):
            for k, axis in enumerate(pair):
                yield f"{axis}_mm", numbers[..., k]
        yield "valid", calibrated.valid.astype(np.uint8)
    yield from strain_values(measurement.strain).items()
