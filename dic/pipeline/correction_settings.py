"""Settings of the corrections of a run's strains for out-of-plane motion."""

import json
from collections.abc import Iterable, Mapping, Sequence, Set
from dataclasses import field, replace
from math import isfinite
from typing import TYPE_CHECKING, Any

from dic.calibration.grid_making import (
    FLATNESS_STD,
    GRID_MADE,
    MAKING,
    SCALE_RATIO_STD,
    SKEW_STD,
    GridAccuracy,
)
from dic.errors import CorrelationError
from dic.out_of_plane.motion import FIXED_FACE, POISSON_RATIO, SHIFT_STD, THICKNESS, TILT_AXIS, Motion
from dic.settings import Number, Pair, setting, settings_class

if TYPE_CHECKING:
    from dic.out_of_plane.alignment import Alignment
    from dic.out_of_plane.shift import Shift
    from dic.runfile.mounting import RunMounting
    from dic.runfile.steps import RunStep
else:
    # The options of commands are made from these classes, and NumPy would delay their help.
    Alignment = Any


@settings_class(CorrelationError)
class SurfaceSettings:
    """The place of the specimen's surface behind the grid's lines."""

    plate_mm: Number | None = setting(
        "distance of the surface",
        "Distance of the specimen's surface behind the grid's lines, such as the thickness of the grid's"
        " plate. Default: the value in the run file, otherwise 0.",
        default=None,
        expected="a number of mm",
        remedy="give --plate-mm 1.0",
        example="1.0",
    )


@settings_class(CorrelationError)
class CorrectionSettings:
    """Settings of the corrections of a run; `alignments` has the known alignment of each camera by its name.

    An alignment comes from an earlier rotation on the same fixture. A shift or a hinge that is not given has
    the value in the run file.
    """

    poisson_ratio: Number = POISSON_RATIO
    alignments: Mapping[str, Alignment] = field(default_factory=dict)
    shift_std_um: Number | None = SHIFT_STD
    tilt_axis_mm: Pair | None = TILT_AXIS
    thickness_mm: Number | None = THICKNESS
    fixed_face: str | None = FIXED_FACE
    grid_made: str | None = GRID_MADE
    scale_ratio_std: Number | None = SCALE_RATIO_STD
    skew_std: Number | None = SKEW_STD
    flatness_std_mm: Number | None = FLATNESS_STD

    @property
    def grid(self) -> GridAccuracy:
        """How accurately the grid was made."""
        return GridAccuracy(**{name: getattr(self, name) for name in MAKING})

    @property
    def shift(self) -> "Shift":
        """The assumed uncertainty of the specimen's shift towards the camera."""
        from dic.out_of_plane.shift import Shift

        return Shift.of(self.shift_std_um, self.tilt_axis_mm, self.thickness_mm, self.fixed_face)

    def completed(
        self, mounting: "RunMounting", thickness_mm: float, making: Mapping[str, Any]
    ) -> "CorrectionSettings":
        """Return the settings; a setting that is not given has the value that the run file declares.

        `thickness_mm` is NaN if the run file states no thickness.
        """
        known_mm = thickness_mm if isfinite(thickness_mm) else None
        declared: dict[str, Any] = {"thickness_mm": known_mm, **vars(mounting), **making}
        names = ("shift_std_um", "tilt_axis_mm", "thickness_mm", "fixed_face", *MAKING)
        values: dict[str, Any] = {name: declared.get(name) for name in names if getattr(self, name) is None}
        return replace(self, **values)

    def require_use(self, source: str, cameras: Sequence[str], kinds: Set[str]) -> None:
        """Raise an error if a run with these cameras and kinds of steps cannot use a given setting.

        Call this before `completed`, because a run file of rotations may declare a hinge, which has no
        effect.

        Raises
        ------
        CorrelationError
            If an alignment is given for a camera that the run does not have, or if the run has steps other
            than rotations; or if a hinge is given for a run of rotations.
        """
        if self.tilt_axis_mm is not None and motion_of(kinds) == "rigid":
            expected, remedy = "a run with loaded steps", "leave out --tilt-axis-mm: a rotation has no grips"
            raise CorrelationError(source, "apply the grips' hinge", expected, "rotations alone", remedy)
        unknown = sorted(set(self.alignments) - set(cameras))
        if unknown:
            expected, got, remedy = f"one of {', '.join(cameras)}", unknown[0], "name a camera of the run"
        elif self.alignments and motion_of(kinds) != "rigid":
            expected, got = "a run of rotations alone", f"steps of {', '.join(sorted(kinds))}"
            remedy = "an alignment serves rotations only"
        else:
            return
        raise CorrelationError(source, "apply alignment", expected, got, remedy)

    def motion(self, kind: str, camera: str) -> Motion:
        """Return the motion of the specimen in a camera's images; `kind` is the result of `motion_of`."""
        if kind == "rigid":
            alignment = self.alignments.get(camera)
            return Motion(kind, self.poisson_ratio, alignment, self.shift_std_um)
        known = self.shift_std_um, self.tilt_axis_mm, self.thickness_mm, self.fixed_face
        return Motion(kind, self.poisson_ratio, None, *known)

    def as_text(self) -> str:
        """Return the settings as JSON text for the result file."""
        alignments = {name: alignment.as_lists() for name, alignment in self.alignments.items()}
        content = {"poisson_ratio": self.poisson_ratio, "alignments": alignments}
        content |= {"shift_std_um": self.shift_std_um, "tilt_axis_mm": self.tilt_axis_mm}
        content |= {"thickness_mm": self.thickness_mm, "fixed_face": self.fixed_face}
        content |= {name: getattr(self, name) for name in MAKING}
        return json.dumps(content)

    @classmethod
    def from_text(cls, text: str) -> "CorrectionSettings":
        """Return the settings from the JSON text that `as_text` returned; older texts lack some values."""
        from dic.out_of_plane.alignment import Alignment

        content = json.loads(text)
        alignments = {name: Alignment.from_lists(lists) for name, lists in content["alignments"].items()}
        hinge_mm = content.get("tilt_axis_mm")
        return cls(
            float(content["poisson_ratio"]),
            alignments,
            content.get("shift_std_um"),
            None if hinge_mm is None else (hinge_mm[0], hinge_mm[1]),
            content.get("thickness_mm"),
            content.get("fixed_face"),
            **{name: content.get(name) for name in MAKING},
        )


def kinds_of(steps: Iterable["RunStep"]) -> set[str]:
    """Return the kinds of a run's steps, from which `motion_of` concludes the specimen's motion.

    Images beside a machine whose load is measured count as those of a test with load steps.
    """
    return {"load" if step.kind == "acquired" and isfinite(step.load_n) else step.kind for step in steps}


def motion_of(kinds: Set[str]) -> str:
    """Return the specimen's motion ("free", "rigid" or "tension") from the kinds of a run's steps."""
    if "rotation" in kinds:
        return "free" if kinds & {"load", "displacement"} else "rigid"
    return "tension" if kinds & {"load", "displacement"} else "free"
