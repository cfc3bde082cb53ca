"""The phase `unload`: a motion back to a lower load."""

from typing import Literal

from pydantic import Field

from rig.protocol.draft import Draft, Phase
from rig.protocol.phases.motion import LoadImages, approach


class Unload(Phase):
    """A motion back to a lower load."""

    do: Literal["unload"]
    load_n: float = Field(default=0.0, ge=0.0)
    rate_n_s: float = Field(gt=0.0)
    images: LoadImages = LoadImages()

    def compile(self, draft: Draft) -> None:
        """Add the motion."""
        move = draft.move_to("load", self.load_n, self.rate_n_s)
        draft.add(approach(draft, move, self.load_n, self.images, down=True))
