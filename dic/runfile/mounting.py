"""Read what a run file says about the making of the grid, and the mounting of grid and specimen."""

from dataclasses import dataclass
from typing import Any, cast, get_args

import numpy as np

from dic.runfile import schema
from dic.runfile.layout import Unlike
from dic.runfile.values import read_text


@dataclass(frozen=True)
class RunMounting:
    """The mounting that the protocol or the rig file of a run declares."""

    plate_mm: float = 0.0
    """Distance of the specimen's surface behind the grid's lines; 0 if it is not declared."""
    tilt_axis_mm: tuple[float, float] | None = None
    """X and Y of the grips' hinge in the grid's axes; None if it is not declared."""
    shift_std_um: float | None = None
    """Standard deviation of the specimen's shift towards the camera; None if it is not declared."""
    fixed_face: schema.FixedFace | None = None
    """The face that the grips hold: "middle", "back" or "front"; None if it is not declared."""


def read_mounting(file: Any) -> RunMounting:
    """Return the mounting in an open run file. Files of earlier versions declare no mounting.

    Raises `Unlike` if a value is infinite, the hinge has one coordinate only, or a face is unknown.
    """
    entry = file["entry"]
    if schema.MOUNTING_GROUP not in entry:
        return RunMounting()
    group = entry[schema.MOUNTING_GROUP]
    plate_mm, shift_std_um = float(group["plate_mm"][()]), float(group["shift_std_um"][()])
    x, y = group["tilt_axis_mm"][:].tolist()
    if np.isinf([plate_mm, shift_std_um, x, y]).any() or np.isnan(x) != np.isnan(y) or shift_std_um < 0.0:
        raise Unlike(f"a mounting of plate {plate_mm} mm, hinge {x}, {y} mm and shift {shift_std_um} µm")
    # Files of earlier versions declare no face.
    face = read_text(group["fixed_face"]) if "fixed_face" in group else ""
    if face not in ("", *get_args(schema.FixedFace)):
        raise Unlike(f"grips that hold the {face!r} of the specimen")
    return RunMounting(
        0.0 if np.isnan(plate_mm) else plate_mm,
        None if np.isnan(x) else (x, y),
        None if np.isnan(shift_std_um) else shift_std_um,
        cast(schema.FixedFace, face) if face else None,
    )


def read_making(group: Any) -> dict[str, Any]:
    """Return how accurately the calibration target in a run file's group of the grid was made.

    The keys are `grid_made`, and the standard deviations `scale_ratio_std`, `skew_std` and `flatness_std_mm`.
    What the file does not declare is left out; files of earlier versions declare nothing.

    Raises `Unlike` if the making is unknown, or a standard deviation is negative or infinite.
    """
    text, *numbers = (item.name for item in schema.MAKING)
    if text not in group:
        return {}
    made, stds = read_text(group[text]), {name: float(group[name][()]) for name in numbers}
    if made not in ("", *get_args(schema.GridMaking)) or any(
        std < 0.0 or np.isinf(std) for std in stds.values()
    ):
        raise Unlike(f"a grid that is made {made!r}, with standard deviations {[*stds.values()]}")
    return ({text: made} if made else {}) | {name: std for name, std in stds.items() if not np.isnan(std)}
