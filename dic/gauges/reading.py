"""Classes for the reading of a gauge in one image."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from dic.typing import Float, Indices

_KEYS = ("strain", "strain_std", "strain_std_images", "extension", "extension_std", "length")


@dataclass(frozen=True)
class SharedPart:
    """Errors of a gauge's strain from calibration and out-of-plane motion, which are equal at all points."""

    covariance: Float
    """Shape (3, 3). Covariance of the errors of exx, eyy, exy."""
    weights: Float
    """Shape (3,). Derivatives of the gauge's strain with respect to exx, eyy, exy."""
    mounting: Float
    """Shape (3, causes). The errors of exx, eyy, exy in `covariance` that follow the measured motion; see
    `Correction.mounting`.
    """


@dataclass(frozen=True)
class Reading:
    """The reading of an extensometer, an area or a point in one image.

    Attributes
    ----------
    unit : str
        Unit of lengths and displacements, "px" or "mm".
    strain : float
        Engineering strain along the gauge: change of length divided by length. NaN if there is no reading.
    strain_std : float
        Standard deviation of `strain`; NaN if it is not known.
    strain_std_images : float
        The part of `strain_std` that the noise of this image and the interpolation cause.
    extension, extension_std : float
        Change of length of an extensometer, and its standard deviation; NaN for other gauges.
    length : float
        Gauge length in the reference, between the middles of the two patches. For an area, the distance
        between its outermost points along its direction.
    points : int
        Number of points with a displacement that were used.
    declared : int
        Number of points in the reference at the gauge's place.
    lines : int or None
        Number of lines that a transverse extensometer used; None for other gauges.
    values : mapping of str to float
        For an area or a point: exx, eyy, exy, e1, e2, direction_deg and rotation_deg, the displacements u and
        v at the place of a point or the centroid of an area (x to the right, y up), and the standard
        deviations of these values. The standard deviations of u and v contain only the part that the images
        cause.
    reason : str
        The reason why there is no reading; "" if there is one.
    shared : SharedPart or None
        The other part of the error in `strain_std`, which is not in `strain_std_images`; None if there is no
        reading.
    """

    unit: str
    strain: float = np.nan
    strain_std: float = np.nan
    strain_std_images: float = np.nan
    extension: float = np.nan
    extension_std: float = np.nan
    length: float = np.nan
    points: int = 0
    declared: int = 0
    lines: int | None = None
    values: Mapping[str, float] = field(default_factory=dict)
    reason: str = ""
    shared: SharedPart | None = None

    def as_dict(self) -> dict[str, Any]:
        """Return the reading for JSON, with None instead of NaN."""
        plain = {name: _plain(value) for name, value in self.numbers().items()}
        counts = {"points": self.points, "points_declared": self.declared}
        lines = {} if self.lines is None else {"lines": self.lines}
        return {"unit": self.unit} | plain | counts | lines | {"reason": self.reason or None}

    def numbers(self) -> dict[str, float]:
        """Return strain, extension and length with their standard deviations, and `values`."""
        numbers = {name: float(getattr(self, name)) for name in _KEYS}
        if self.values:
            numbers.pop("extension")
            numbers.pop("extension_std")
        return numbers | dict(self.values)


@dataclass(frozen=True)
class Profile:
    """Displacement and strain along a line cut in one image.

    Attributes
    ----------
    unit : str
        Unit of distances and displacements, "px" or "mm".
    distance : ndarray, shape (places,)
        Distance of each place from the start of the cut, in the unit of the gauge.
    distance_unit : str
    values : mapping of str to ndarray, shape (places,)
        u, v, exx, eyy and exy, and their standard deviations; NaN where a place has no value.
    points, declared : ndarray of int, shape (places,)
        Number of points that were used at each place, and number of points at each place in the reference.
    reason : str
        The reason why no place has a value; "" otherwise.
    """

    unit: str
    distance: Float
    distance_unit: str
    values: Mapping[str, Float]
    points: Indices
    declared: Indices
    reason: str = ""

    def __repr__(self) -> str:
        known = int(np.isfinite(self.values["exx"]).sum())
        return f"Profile({known} of {len(self.distance)} places with a value, {self.unit})"

    def as_dict(self) -> dict[str, Any]:
        """Return the profile for JSON, with None instead of NaN."""
        lists = {name: [_plain(value) for value in values] for name, values in self.values.items()}
        counts = {
            "points": [int(n) for n in self.points],
            "points_declared": [int(n) for n in self.declared],
        }
        distances = {f"distance_{self.distance_unit}": [float(value) for value in self.distance]}
        return {"unit": self.unit} | distances | lists | counts | {"reason": self.reason or None}


def _plain(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
