"""The assumed motion of a specimen, used to correct calibrated strain for out-of-plane motion."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from dic.errors import CorrelationError, require_all
from dic.out_of_plane.expected_shift import FACES, FARTHEST_MM, HINGE_STD_UM, SHIFT_STD_UM, THICKEST_MM
from dic.settings import Number, Pair, one_of, place_of, setting, settings_class

if TYPE_CHECKING:
    from dic.out_of_plane.alignment import Alignment
    from dic.out_of_plane.shift import Shift
    from dic.strain.still import StillErrors
else:
    # The options of commands are made from this class, and NumPy would delay their help.
    Alignment = StillErrors = Any

MOTIONS = ("free", "rigid", "tension")
"""Kinds of motion: unknown motion, rotation without strain, and uniform tension with some bending."""

POISSON_RATIO: Any = setting(
    "Poisson's ratio",
    "Poisson's ratio of the specimen, for bending.",
    default=0.33,
    expected="0 to 0.5",
    remedy="give a Poisson's ratio of 0.33 for most metals",
    ge=0.0,
    le=0.5,
)
SHIFT_STD: Any = setting(
    "standard deviation of the shift",
    "Standard deviation of the specimen's shift towards the camera since the reference, µm:"
    f" one camera cannot measure the shift. Default: {SHIFT_STD_UM:g}, or {HINGE_STD_UM:g} with"
    " --tilt-axis-mm, and more with the travel of the specimen. The shift by a known tilt axis or a known"
    " thickness is corrected and does not count.",
    default=None,
    expected="0 to 10000 µm",
    remedy=f"give --shift-std-um {SHIFT_STD_UM:g}, the default, or 0 if the specimen kept its distance",
    example="30.0",
    unit="µm",
    check=lambda std: std is None or 0.0 <= std <= 1e4,
)
TILT_AXIS: Any = setting(
    "axis of the tilt",
    "Place of the grips' hinge in the grid's axes, mm, where the specimen keeps its distance to the camera:"
    " 0,-30 for a hinge 30 mm below the grid's centre. One number is Y. One camera then computes the shift"
    " from the tilt.",
    default=None,
    expected=f"X and Y of the grips' hinge in mm, at most {FARTHEST_MM:g} mm away",
    remedy="give --tilt-axis-mm 0,-30 for a hinge 30 mm below the grid's centre, or leave it out",
    example="[0.0, -30.0]",
    metavar="X,Y",
    read=place_of,
    check=lambda hinge: hinge is None or all(abs(each) <= FARTHEST_MM for each in hinge),
)
THICKNESS: Any = setting(
    "thickness of the specimen",
    "Thickness of the specimen before the test, mm. The surface moves back as the specimen becomes thinner;"
    " one camera then computes this shift from the strain. Default: that of the run file, otherwise unknown.",
    default=None,
    expected=f"more than 0 mm and at most {THICKEST_MM:g} mm",
    remedy="give --thickness-mm 2, or leave it out",
    example="2.0",
    check=lambda thickness: thickness is None or 0.0 < thickness <= THICKEST_MM,
)
FIXED_FACE: Any = setting(
    "fixed face",
    "What the grips hold in place while the specimen becomes thinner: its middle, its back (the face away"
    " from the camera), or its front. Default: unknown, which enters the standard deviation.",
    default=None,
    expected=one_of(FACES),
    remedy="give --fixed-face middle for grips that centre the specimen, or leave it out",
    example='"middle"',
    metavar="FACE",
    read=str,
    among=(None, *FACES),
)


@settings_class(CorrelationError)
class Motion:
    """Assumed motion of a specimen, used to correct calibrated strain for out-of-plane motion."""

    kind: str = setting(
        "motion",
        "Motion of the specimen, to correct calibrated strain for motion out of the grid's plane:"
        " rigid (a rotation), tension, or free (unknown, no correction).",
        default="free",
        expected=one_of(MOTIONS),
        remedy="give the motion tension or rigid, or free if it is not known",
        option="--motion",
        among=MOTIONS,
    )
    poisson_ratio: Number = POISSON_RATIO
    alignment: Alignment | None = None
    shift_std_um: Number | None = SHIFT_STD
    tilt_axis_mm: Pair | None = TILT_AXIS
    thickness_mm: Number | None = THICKNESS
    fixed_face: str | None = FIXED_FACE
    still: StillErrors | None = None

    def __post_init__(self) -> None:
        checks = [
            (
                self.alignment is None or self.kind == "rigid",
                "apply alignment",
                "--motion rigid",
                self.kind,
                "give an alignment with --motion rigid only, or leave it out",
            ),
            (
                self.tilt_axis_mm is None or self.kind != "rigid",
                "axis of the tilt",
                "--motion tension",
                self.kind,
                "leave --tilt-axis-mm out, because a rotation stage has no grips",
            ),
        ]
        require_all(CorrelationError, "settings", checks)

    @property
    def shift(self) -> "Shift":
        """Knowledge about the specimen's shift towards the camera."""
        from dic.out_of_plane.shift import Shift

        known = Shift.of(self.shift_std_um, self.tilt_axis_mm, self.thickness_mm, self.fixed_face)
        # A rotating specimen is rigid: it does not become thinner, and its grips do not travel.
        return Shift(known.std_um) if self.kind == "rigid" else known

    def as_dict(self) -> dict[str, Any]:
        """Return the attributes as values for JSON."""
        alignment = None if self.alignment is None else self.alignment.as_lists()
        still = None if self.still is None else self.still.as_dict()
        return vars(self) | {"alignment": alignment, "still": still}

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> "Motion":
        """Return the motion from the values that `as_dict` returned."""
        from dic.out_of_plane.alignment import Alignment
        from dic.strain.still import StillErrors

        alignment, hinge_mm = values["alignment"], values["tilt_axis_mm"]
        return cls(
            values["kind"],
            values["poisson_ratio"],
            None if alignment is None else Alignment.from_lists(alignment),
            values["shift_std_um"],
            None if hinge_mm is None else (hinge_mm[0], hinge_mm[1]),
            # Results of earlier versions lack these values.
            values.get("thickness_mm"),
            values.get("fixed_face"),
            StillErrors.from_dict(values.get("still")),
        )
