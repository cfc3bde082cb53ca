"""The rotation protocol of the paper: rigid rotation of the specimen in increments."""

import math
from functools import cached_property
from typing import Literal

from pydantic import Field, model_validator

from drivers.settings import Settings
from rig.protocol.approach import Approach
from rig.protocol.base import BaseProtocol
from rig.protocol.conditions import Conditions, Demand, StageTurn
from rig.protocol.course import Beginning, Course, Positions
from rig.protocol.move import Move
from rig.protocol.tables import RotationSettle, too_fine


class Rotation(Settings):
    """Settings for the increments of angle, from the reference at 0 degrees to a total angle.

    The last increment is smaller if the total is not a multiple of the increment.
    """

    increment_deg: float = Field(gt=0.0)
    total_deg: float = Field(gt=0.0)


class RotationProtocol(BaseProtocol):
    """Protocol of a rotation test: rigid rotation of the specimen in increments."""

    kind: Literal["rotation"]
    rotation: Rotation
    settle: RotationSettle

    @model_validator(mode="after")
    def _agrees_with_itself(self) -> "RotationProtocol":
        tolerance_deg = self.settle.angle_tolerance_deg
        mistakes = too_fine("rotation.increment_deg", self.rotation.increment_deg, tolerance_deg)
        if self.mounting.tilt_axis_mm is not None:
            mistakes.append("mounting.tilt_axis_mm must be left out, because a rotation stage has no grips")
        if mistakes:
            raise ValueError("; ".join(mistakes))
        return self

    @cached_property
    def course(self) -> Course:
        """The course of the test: grid and reference images, then a turn to an angle in increments."""
        turn = Move("rotation", math.nan, self.settle.angle_tolerance_deg, is_timed=False)
        approach = Approach(turn, self.rotation.total_deg, self.rotation.increment_deg)
        return Course((Beginning.of(self.images), approach), Positions())

    @property
    def conditions(self) -> Conditions:
        """The requirements of the protocol for the rig."""
        return Conditions(
            devices=frozenset({"stage"}),
            zero_tolerance_deg=self.settle.angle_tolerance_deg,
            demands=(Demand("rotation.total_deg", self.rotation.total_deg, "angle_max_deg", "deg"),),
            turns=(StageTurn("a step", self.rotation.increment_deg),),
        )
