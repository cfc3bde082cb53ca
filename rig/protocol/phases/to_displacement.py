"""The phase `to-displacement`: a motion to a larger displacement."""

from typing import Literal

from rig.protocol.draft import Draft, Increment, Positive, Signed
from rig.protocol.phases.motion import MotionImages, Pulling


class DisplacementImages(MotionImages):
    """The times of images during a motion to a displacement."""

    every_mm: Increment = None

    @property
    def increment(self) -> float | None:
        """The increment in mm."""
        return self.every_mm


class ToDisplacement(Pulling):
    """A motion to a larger displacement, counted from the reference. It is negative in compression."""

    do: Literal["to-displacement"]
    displacement_mm: Signed
    speed_mm_s: Positive
    images: DisplacementImages = DisplacementImages()

    def compile(self, draft: Draft) -> None:
        """Add the motion."""
        move = draft.move_to("displacement", self.displacement_mm, self.speed_mm_s)
        draft.add(self.approach(draft, move, self.displacement_mm, self.images))
