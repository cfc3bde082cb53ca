"""Names and units of the values in result files; `docs/results.md` describes the layout."""

from dataclasses import dataclass, fields

from dic.strain.strain import MeanStrain

FORMAT = "offaxis-results"
VERSION = 1
FINISHED = "finished"
"""Attribute of a result file: 0 while images may be missing, 1 afterwards; older files have none."""
OUTPUTS = "outputs"
"""Attribute of the provenance: the other files that the measurement writes, as JSON."""
MEAN_KEYS = tuple(field.name for field in fields(MeanStrain))
PLANE_KEYS = (
    "slope_x_deg", "slope_y_deg", "slope_x_deg_std", "slope_y_deg_std", "shift_mm", "shift_mm_std"
)  # fmt: skip
"""Names, in `Correction.as_dict`, of the slopes and the shift of the specimen's plane."""
SHARED_KEY = "shared_covariance"
"""Name of the covariance of errors of exx, eyy, exy that are equal at all points."""
MOUNTING_KEY = "mounting_errors"
"""Name of the errors of exx, eyy, exy that an unknown mounting of the specimen causes."""


JOINT = "both"
"""Group of the results that two cameras give together."""
STEP_UNITS = {
    "index": "1", "target": "by kind: N, mm or deg", "load_n": "N", "displacement_mm": "mm",
    "angle_deg": "deg", "time_s": "s",
}  # fmt: skip
"""Columns of the steps of a run, with their units."""
LATER_STEP_UNITS = {
    "load_std_n": "N", "displacement_std_mm": "mm", "angle_std_deg": "deg", "time_std_s": "s",
    "load_lag_n": "N", "due_s": "s", "late_s": "s",
}  # fmt: skip
"""Further columns, which files of earlier versions lack."""
CHANNELS, CHANNEL_COLUMNS = "channels", ("value", "std", "lag")
"""Group of the steps that has a group for each channel, and the columns of such a group."""


@dataclass(frozen=True)
class CameraLayout:
    """The groups of a result file that contain what is known of one camera."""

    place: str
    rows: str
    """Group with the displacements and strains of the images."""
    calibration: str
    """Group of the calibration."""

    @classmethod
    def of(cls, camera: str) -> "CameraLayout":
        """Return the groups of a run's camera; the name of the camera of a series of image files is ""."""
        if not camera:
            return cls("series", "series", "calibration")
        place = f"cameras/{camera}"
        return cls(place, f"{place}/series", f"{place}/calibration")

    @property
    def images(self) -> str:
        """Group with the outcome of each image."""
        return f"{self.place}/images"


def units_of(name: str) -> str:
    """Return the unit of a value in a result file from the value's name: "px", "mm", "deg" or "1"."""
    return next((unit for unit in ("px", "mm", "deg") if f"_{unit}" in name), "1")
