"""Read what a run file says about the mounting of the grid and of the specimen."""

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
