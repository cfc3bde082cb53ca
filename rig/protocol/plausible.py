"""Bounds for the plausible behaviour of specimen, grips and machine, to detect a wrong load reading."""

from typing import Self

from pydantic import Field, model_validator

from rig.limit_settings import MachineBounds


class Plausible(MachineBounds):
    """Bounds for the agreement of load and displacement. A missing bound is derived from the others.

    The load string is the specimen with grips and load frame in series. All values belong to the first
    loading, in tension. `rig.limits.stiffness` gives the defaults and their physics.
    """

    modulus_min_mpa: float | None = Field(
        default=None, gt=0.0, description="smallest possible Young's modulus"
    )
    modulus_max_mpa: float | None = Field(
        default=None, gt=0.0, description="largest possible Young's modulus"
    )
    grip_length_mm: float | None = Field(
        default=None, gt=0.0, description="free length between the grips; default: the gauge length"
    )
    slack_mm: float | None = Field(
        default=None, ge=0.0, description="largest displacement before the load begins to rise"
    )
    flow_mm: float = Field(
        default=0.0, ge=0.0, description="largest displacement at constant load: slip, or a yield plateau"
    )
    relaxation: float | None = Field(
        default=None, ge=0.0, lt=1.0, description="fall of the load at rest per decade of time, as a fraction"
    )
    speed_max_mm_s: float | None = Field(
        default=None, gt=0.0, description="largest speed of the crosshead in an increment of load"
    )

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        for what in ("modulus_{}_mpa", "machine_stiffness_{}_n_mm"):
            least, greatest = (getattr(self, what.format(end)) for end in ("min", "max"))
            if least is not None and greatest is not None and least >= greatest:
                raise ValueError(f"{what.format('min')} must be below {what.format('max')}, {greatest:g}")
        return self
