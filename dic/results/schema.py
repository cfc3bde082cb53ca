"""Names and units of the values in result files; `docs/results.md` describes the layout."""

from dataclasses import fields

from dic.strain.strain import MeanStrain

FORMAT = "offaxis-results"
VERSION = 1
MEAN_KEYS = tuple(field.name for field in fields(MeanStrain))
PLANE_KEYS = (
    "slope_x_deg", "slope_y_deg", "slope_x_deg_std", "slope_y_deg_std", "shift_mm", "shift_mm_std"
)  # fmt: skip
"""Names, in `Correction.as_dict`, of the slopes and the shift of the specimen's plane."""
SHARED_KEY = "shared_covariance"
"""Name of the covariance of errors of exx, eyy, exy that are equal at all points."""
MOUNTING_KEY = "mounting_errors"
"""Name of the errors of exx, eyy, exy that an unknown mounting of the specimen causes."""


def units_of(name: str) -> str:
    """Return the unit of a value in a result file from the value's name: "px", "mm", "deg" or "1"."""
    return next((unit for unit in ("px", "mm", "deg") if f"_{unit}" in name), "1")
