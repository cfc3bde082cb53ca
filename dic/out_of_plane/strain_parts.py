"""The parts of the standard deviation of a strain; each part has a cause that the user can reduce."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from dic.out_of_plane.causes import OUT_OF_PLANE, CameraSight, fields, places
from dic.out_of_plane.expectations import unmeasured
from dic.out_of_plane.linearised import PARTS
from dic.out_of_plane.plane import Plane
from dic.out_of_plane.shift import Shift
from dic.out_of_plane.uncertainty import Points
from dic.strain.fit import gradient_weights
from dic.strain.tensor import strain_covariance
from dic.typing import Float

PART_NAMES = ("images", *PARTS)
"""The names of the parts of a standard deviation.

images: noise of the images. calibration: errors of the calibration. still: errors that still images show,
such as haze. mounting: the unknown tilt and distance
between the specimen's surface and the grid's plane in the reference. model: tilt, bending, strain gradient
and taper, which the fit determines with an uncertainty only. shift: motion of the specimen towards the
camera, which one camera cannot measure.
"""


_STRAINS = ("exx", "eyy", "exy")

UNCERTAINTY_KEYS = (
    *(f"{name}_std_{part}" for part in PART_NAMES for name in _STRAINS),
    "curved_probability",
    "graded_probability",
    "thinning_um",
    "contraction_um",
    "contraction_std_um",
    "contraction_contradicts",
)
"""Names of the parts of the standard deviations, of probabilities, and of shifts by thinning and as the
lateral contraction shows them, in result files and JSON."""


@dataclass(frozen=True)
class StrainParts:
    """Parts of the standard deviations of the mean strains exx, eyy, exy."""

    parts: Mapping[str, Float]
    """Each of shape (3,). The standard deviations by their causes, with the keys `PART_NAMES`. The root sum
    of squares of all parts is the standard deviation of the strain.
    """
    shared: Float
    """Shape (3, 3). Covariance of exx, eyy, exy that all parts except "images" cause."""

    def as_dict(self) -> dict[str, float]:
        """Return the values under the names `exx_std_images` …."""
        return {
            f"{name}_std_{part}": float(values[k])
            for part, values in self.parts.items()
            for k, name in enumerate(_STRAINS)
        }

    @classmethod
    def of(cls, gradient: Float, covariances: Mapping[str, Float], measure: str) -> "StrainParts":
        """Return the parts for covariances (4, 4) of a mean displacement gradient (2, 2)."""
        strains = {
            name: strain_covariance(gradient, covariance, measure) for name, covariance in covariances.items()
        }
        shared = np.sum([value for name, value in strains.items() if name != "images"], axis=0)
        parts = {name: np.sqrt(np.maximum(np.diag(value), 0.0)) for name, value in strains.items()}
        return cls(parts, np.asarray(shared))


def open_parts(points: Points, shift: Shift) -> tuple[Float, dict[str, Float]]:
    """Return the mean gradient (2, 2) of calibrated displacements, and its covariances (4, 4) by cause.

    No motion out of the plane is measured, so the covariances contain the whole motion that is expected.
    """
    pinhole = points.calibration.pinhole
    if pinhole is None:
        raise ValueError("this calibration knows no camera centre")
    weights, gradient = gradient_weights(points.before_mm), points.mean_gradient
    sight = CameraSight.of(points.before_mm, points.after_mm, pinhole.centre_mm, weights)
    shift = shift.during(points, gradient)
    thinned_mm = 0.0 if shift.thickness_mm is None else shift.thinned_mm(gradient)
    false = fields(sight, Plane(), gradient, 0.0, np.array([1.0, 0.0]), shift.per_slope_mm)
    of_map, _ = points.calibration_factors(weights)
    covariances = {
        "images": points.noise_covariance(weights) + points.smooth_covariance(weights),
        "calibration": np.asarray(of_map @ of_map.T),
        "still": points.still_covariance(weights),
    }
    at, std = places(), unmeasured(float(np.hypot(shift.std_mm, thinned_mm)))
    for part, names in PARTS.items():
        for name in names:
            here = false[:, at[name]] * std[at[name]] if name in OUT_OF_PLANE else np.zeros((4, 1))
            covariances[part] = covariances.get(part, 0.0) + here @ here.T
    return gradient, covariances
