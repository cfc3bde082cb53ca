"""The table [limits] of a rig file: limits of the rig for every run, and the stiffness of the machine."""

from pydantic import Field

from drivers.settings import Settings


class MachineBounds(Settings):
    """Bounds for the behaviour of grips and load frame, in the rig file and in a protocol."""

    machine_stiffness_min_n_mm: float | None = Field(
        default=None, gt=0.0, description="smallest stiffness of grips and load frame in series"
    )
    machine_stiffness_max_n_mm: float | None = Field(
        default=None, gt=0.0, description="largest stiffness of grips and load frame in series"
    )
    seating_mm: float | None = Field(
        default=None, ge=0.0, description="largest displacement by which a specimen seats in the grips"
    )
    seating_stiffness_n_mm: float | None = Field(
        default=None, gt=0.0, description="smallest rise of the load per mm while the grips seat"
    )


class RigLimits(MachineBounds):
    """Limits of the rig. If the protocol also limits a quantity, the narrower limit applies."""

    load_max_n: float | None = Field(
        default=None, gt=0.0, description="largest load in tension and in compression"
    )
    displacement_max_mm: float | None = Field(
        default=None, gt=0.0, description="largest displacement in both directions"
    )
    speed_max_mm_s: float | None = Field(default=None, gt=0.0)
    load_rate_max_n_s: float | None = Field(default=None, gt=0.0)
    angle_min_deg: float | None = Field(default=None)
    angle_max_deg: float | None = Field(default=None)
    unloaded_max_n: float | None = Field(
        default=None, gt=0.0, description="load up to which a specimen counts as unloaded in a rotation test"
    )
    specimen_stiffness_min_n_mm: float | None = Field(
        default=None,
        gt=0.0,
        description="smallest stiffness of the specimens that rig jog and rig unload move",
    )
