"""The phase `rotate`: a turn of the stage to an angle."""

import math
from typing import Literal

from drivers.settings import Settings
from rig.protocol.approach import Approach
from rig.protocol.conditions import StageTurn
from rig.protocol.draft import Draft, Increment, Phase


class AngleImages(Settings):
    """The times of images during a turn to an angle. By default they are taken once, at the end."""

    every_deg: Increment = None


class Rotate(Phase):
    """A turn of the stage to an angle, counted from the reference at 0 degrees."""

    do: Literal["rotate"]
    angle_deg: float
    images: AngleImages = AngleImages()

    def compile(self, draft: Draft) -> None:
        """Add the turn."""
        move = draft.move("rotation", is_timed=False)
        start_deg = draft.place.rotation.low
        every_deg = math.inf if self.images.every_deg is None else self.images.every_deg
        if every_deg < math.inf:
            draft.check_increment("images.every_deg", every_deg, move)
        if abs(self.angle_deg - start_deg) <= move.tolerance:
            draft.mistake(f"an angle other than {start_deg:g} deg, where the phase starts, is expected")
        lowest, highest = sorted((start_deg, self.angle_deg))
        draft.demand("angle_deg", highest, "angle_max_deg", "deg")
        draft.demand("angle_deg", lowest, "angle_min_deg", "deg", is_lowest=True)
        draft.turns.append(StageTurn(f"a step of {draft.where}", min(every_deg, highest - lowest)))
        draft.add(Approach(move, self.angle_deg, every_deg, down=self.angle_deg < start_deg))
