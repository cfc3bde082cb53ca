"""Names and units of the values in result files; `docs/results.md` describes the layout."""

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
"""Units of the slopes and the shift of the specimen's plane that a correction finds.

The names are those of `Correction.as_dict`.
"""


def strain_units(name: str) -> str:
    """Return the unit of a value whose name is in `MEAN_KEYS` or `STRAIN_KEYS`."""
    return "deg" if "_deg" in name else "1"
