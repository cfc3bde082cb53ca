"""The tension protocol of the paper: increments of load until the specimen yields, then of displacement."""

from functools import cached_property
from typing import Literal

from pydantic import Field, model_validator

from drivers.settings import Settings
from rig.errors import ProtocolError
from rig.protocol.approach import Approach
from rig.protocol.base import BaseProtocol
from rig.protocol.conditions import TARE_PER_INCREMENT, Conditions, Demand, Pull, Zeroing
from rig.protocol.course import Beginning, Course, Positions
from rig.protocol.move import Ending, Move
from rig.protocol.plasticity import PlasticCriterion
from rig.protocol.plausible import Plausible
from rig.protocol.step import RigReading
from rig.protocol.tables import Limits, TensionSettle, too_fine


class Loading(Settings):
    """Settings for the increments of load. The increments end when plastic deformation is evident."""

    increment_n: float = Field(gt=0.0)
    increments_max: int = Field(
        ge=2, le=1000, description="largest number of increments; the run fails if none of them is plastic"
    )
    rate_n_s: float = Field(gt=0.0)
    tare_max_n: float = Field(ge=0.0, description="highest load that may be set to zero at the reference")
    plastic: PlasticCriterion

    @property
    def tare_limit_n(self) -> float:
        """The largest accepted value of `tare_max_n`, in N."""
        return TARE_PER_INCREMENT * self.increment_n


class Stretching(Settings):
    """Settings for the increments of displacement up to a total. The last increment is smaller if the total
    is not a multiple of the increment."""

    increment_mm: float = Field(gt=0.0)
    total_mm: float = Field(gt=0.0, description="largest displacement, counted from the reference")
    speed_mm_s: float = Field(gt=0.0)


class TensionProtocol(BaseProtocol):
    """Protocol of a tension test: load increments until plastic deformation, then displacement increments."""

    kind: Literal["tension"]
    loading: Loading
    stretching: Stretching
    settle: TensionSettle
    limits: Limits
    plausible: Plausible = Plausible()

    @model_validator(mode="after")
    def _agrees_with_itself(self) -> "TensionProtocol":
        loading, stretching, settle, limits = self.loading, self.stretching, self.settle, self.limits
        highest_n = loading.increment_n * loading.increments_max + settle.load_tolerance_n
        farthest_mm = stretching.total_mm + settle.displacement_tolerance_mm
        times_s = {
            "loading.increment_n at loading.rate_n_s": loading.increment_n / loading.rate_n_s,
            "stretching.increment_mm at stretching.speed_mm_s": stretching.increment_mm
            / stretching.speed_mm_s,
        }
        mistakes = [
            f"{name} and settle.dwell_s take {time_s + settle.dwell_s:.4g} s together, "
            f"which must be less than settle.timeout_s, {settle.timeout_s:g}"
            for name, time_s in times_s.items()
            if time_s + settle.dwell_s >= settle.timeout_s
        ]
        if loading.tare_max_n > loading.tare_limit_n:
            mistakes.append(
                f"loading.tare_max_n must be at most {loading.tare_limit_n:g} ({TARE_PER_INCREMENT:.0%} of "
                f"loading.increment_n), because a load that is zeroed is missing from every later reading, "
                f"got {loading.tare_max_n:g}"
            )
        mistakes += too_fine("loading.increment_n", loading.increment_n, settle.load_tolerance_n)
        mistakes += too_fine(
            "stretching.increment_mm", stretching.increment_mm, settle.displacement_tolerance_mm
        )
        if highest_n > limits.load_max_n:
            mistakes.append(
                f"limits.load_max_n must be at least {highest_n:g} "
                f"(loading.increments_max increments and the tolerance), got {limits.load_max_n:g}"
            )
        if farthest_mm > limits.displacement_max_mm:
            mistakes.append(
                f"limits.displacement_max_mm must be at least {farthest_mm:g} "
                f"(stretching.total_mm and the tolerance), got {limits.displacement_max_mm:g}"
            )
        if mistakes:
            raise ValueError("; ".join(mistakes))
        return self

    @cached_property
    def course(self) -> Course:
        """The course of the test: grid images, reference images, load increments, displacement increments."""
        loading, stretching, settle = self.loading, self.stretching, self.settle
        to_load = Approach(
            Move("load", loading.rate_n_s, settle.load_tolerance_n, is_timed=False),
            loading.increments_max * loading.increment_n,
            loading.increment_n,
            ending=Ending(loading.plastic, self._not_plastic),
        )
        to_displacement = Approach(
            Move("displacement", stretching.speed_mm_s, settle.displacement_tolerance_mm, is_timed=False),
            stretching.total_mm,
            stretching.increment_mm,
        )
        return Course((Beginning.of(self.images), to_load, to_displacement), Positions.within(self.limits))

    @property
    def conditions(self) -> Conditions:
        """The requirements of the protocol for the rig."""
        limits, loading, stretching, settle = self.limits, self.loading, self.stretching, self.settle
        return Conditions(
            devices=frozenset({"load_frame"}),
            limits=limits,
            carried_n=loading.increment_n,
            zeroing=Zeroing(
                loading.tare_max_n,
                "loading.tare_max_n",
                settle.load_tolerance_n,
                settle.displacement_tolerance_mm,
            ),
            pull=Pull(
                loading.increment_n,
                loading.rate_n_s,
                assured_n=loading.plastic.first_judged_n(loading.increment_n),
                elastic_n=loading.plastic.judged_above_n,
            ),
            demands=(
                *Demand.of_limits(limits),
                Demand("loading.rate_n_s", loading.rate_n_s, "load_rate_max_n_s", "N/s"),
                Demand("stretching.speed_mm_s", stretching.speed_mm_s, "speed_max_mm_s", "mm/s"),
            ),
        )

    def _not_plastic(self, reading: RigReading) -> ProtocolError:
        fraction = self.loading.plastic.stiffness_fraction
        return ProtocolError(
            f"loading to {reading.load_n:.0f} N",
            self.loading.plastic.describe(),
            "none",
            f"check the specimen; if it did not yield, raise loading.increments_max above "
            f"{self.loading.increments_max}; if it did, raise loading.plastic.stiffness_fraction "
            f"above {fraction:g}",
        )
