"""The tables that all protocols share: specimen, images, settling and limits."""

from pydantic import Field

from drivers.settings import Settings


class Sample(Settings):
    """The geometry of the specimen, as declared in the protocol."""

    name: str = Field(min_length=1, max_length=200)
    thickness_mm: float = Field(gt=0.0)
    width_mm: float = Field(gt=0.0)
    gauge_length_mm: float = Field(gt=0.0)


class Settle(Settings):
    """The times for settling, which are the same for load, displacement and angle."""

    dwell_s: float = Field(gt=0.0, description="time for which the value must stay within its tolerance")
    timeout_s: float = Field(gt=0.0, description="longest time from the command to the end of the dwell")
    poll_s: float = Field(default=0.1, gt=0.0, le=1.0, description="time between two readings")


class TensionSettle(Settle):
    """The conditions under which load and displacement count as settled."""

    load_tolerance_n: float = Field(gt=0.0)
    displacement_tolerance_mm: float = Field(gt=0.0)


class RotationSettle(Settle):
    """The conditions under which the angle counts as settled."""

    angle_tolerance_deg: float = Field(gt=0.0)


class PhasesSettle(Settle):
    """The conditions under which load, displacement and angle count as settled, for protocols with phases.

    A motion of the load frame may take its planned time and `timeout_s`. A rotation must end within
    `timeout_s`.
    """

    load_tolerance_n: float | None = Field(default=None, gt=0.0)
    displacement_tolerance_mm: float | None = Field(default=None, gt=0.0)
    angle_tolerance_deg: float | None = Field(default=None, gt=0.0)


class Limits(Settings):
    """Limits that are checked at every reading. A value beyond its limit ends the run at once."""

    load_max_n: float = Field(gt=0.0)
    displacement_max_mm: float = Field(gt=0.0)
    break_load_drop: float = Field(
        gt=0.0, lt=1.0, description="a drop by more than this fraction of the highest load is a break"
    )


def too_fine(name: str, increment: float, tolerance: float) -> list[str]:
    """Return a mistake if an increment is so small that it could count as reached before its motion."""
    if increment > 2.0 * tolerance:
        return []
    return [f"{name} must be more than twice its settle tolerance, {tolerance:g}, got {increment:g}"]
