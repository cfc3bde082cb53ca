"""Names and units in result files, for their writer and reader; the layout is in `docs/results.md`."""

from dataclasses import fields

from dic.strain.strain import MeanStrain

FORMAT = "offaxis-results"
VERSION = 1
MEAN_KEYS = tuple(field.name for field in fields(MeanStrain))
PLANE_UNITS = {
    "slope_x_deg": "deg",
    "slope_y_deg": "deg",
    "slope_x_deg_std": "deg",
    "slope_y_deg_std": "deg",
    "shift_mm": "mm",
    "shift_mm_std": "mm",
}
"""The specimen's plane found by a correction, under the names of `Correction.as_dict`."""


def strain_units(name: str) -> str:
    """Return the units of a value of `MEAN_KEYS`, which include the values of local strain."""
    return "deg" if "_deg" in name else "1"
