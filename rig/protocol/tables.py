"""The tables that all protocols share: specimen, images, settling and limits."""

from typing import Self

from pydantic import Field, model_validator

from drivers.settings import Settings

CARRIED_SHARE = 0.1
"""Only above this share of the largest load a fall of the load counts, as the grips may seat below it."""


class Sample(Settings):
    """The geometry of the specimen, as declared in the protocol."""

    name: str = Field(min_length=1, max_length=200)
    thickness_mm: float = Field(gt=0.0)
    width_mm: float = Field(gt=0.0)
    gauge_length_mm: float = Field(gt=0.0)
    direction_deg: float | None = Field(
        default=None, ge=0.0, lt=180.0, description="angle between the load and the rolling direction"
    )


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
    """Limits that are checked at every reading. A value beyond its limit ends the run at once.

    Loads and displacements are positive in tension and negative in compression. Without a lower limit, the
    upper limit applies in both directions.
    """

    load_max_n: float = Field(gt=0.0)
    load_min_n: float | None = Field(default=None, lt=0.0, description="largest load in compression")
    displacement_max_mm: float = Field(gt=0.0)
    displacement_min_mm: float | None = Field(
        default=None, lt=0.0, description="largest displacement in compression"
    )
    break_load_drop: float = Field(
        gt=0.0, lt=1.0, description="a drop by more than this fraction of the highest load is a break"
    )
    buckling_load_drop: float | None = Field(
        default=None,
        gt=0.0,
        lt=1.0,
        description="in compression, a drop by more than this fraction of the largest load is buckling",
    )

    @model_validator(mode="after")
    def _buckling_in_compression(self) -> Self:
        if self.buckling_load_drop is not None and self.load_min_n is None:
            raise ValueError("buckling_load_drop needs load_min_n; add it, as only compression buckles")
        return self

    @property
    def load_least_n(self) -> float:
        """The lower limit of the load in N."""
        return -self.load_max_n if self.load_min_n is None else self.load_min_n

    @property
    def displacement_least_mm(self) -> float:
        """The lower limit of the displacement in mm."""
        return -self.displacement_max_mm if self.displacement_min_mm is None else self.displacement_min_mm

    def carried_n(self, sense: float) -> float:
        """Return the load above which a fall counts, in tension (`sense` 1) or in compression (-1)."""
        return CARRIED_SHARE * (self.load_max_n if sense > 0.0 else -self.load_least_n)

    def drop(self, sense: float) -> float:
        """Return the drop of the load that ends the run, as a fraction, for a `sense` as in `carried_n`."""
        in_compression = sense < 0.0 and self.buckling_load_drop is not None
        return self.buckling_load_drop or 0.0 if in_compression else self.break_load_drop


def too_fine(name: str, increment: float, tolerance: float) -> list[str]:
    """Return a mistake if an increment is so small that it could count as reached before its motion."""
    if increment > 2.0 * tolerance:
        return []
    return [f"{name} must be more than twice its settle tolerance, {tolerance:g}, got {increment:g}"]
