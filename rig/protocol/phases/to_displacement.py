"""The phase `to-displacement`: a motion to a larger displacement."""

from typing import Literal

from pydantic import Field

from rig.protocol.draft import Draft
from rig.protocol.phases.motion import MotionImages, Pulling


class DisplacementImages(MotionImages):
    """The times of images during a motion to a displacement."""

    every_mm: float | None = Field(
        default=None, gt=0.0, description="increment after which the motion stops and settles"
    )

    @property
    def increment(self) -> float | None:
        """The increment in mm."""
        return self.every_mm


class ToDisplacement(Pulling):
    """A motion to a larger displacement, counted from the reference."""

    do: Literal["to-displacement"]
    displacement_mm: float = Field(gt=0.0)
    speed_mm_s: float = Field(gt=0.0)
    images: DisplacementImages = DisplacementImages()

    def compile(self, draft: Draft) -> None:
        """Add the motion."""
        move = draft.to_displacement(self.displacement_mm, self.speed_mm_s)
        draft.add(self.approach(draft, move, self.displacement_mm, self.images))
