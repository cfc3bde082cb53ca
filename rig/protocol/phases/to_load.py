"""The phase `to-load`: a motion to a higher load in tension or in compression."""

from typing import Literal

from rig.protocol.draft import Draft, Positive, Signed
from rig.protocol.phases.motion import LoadImages, Pulling


class ToLoad(Pulling):
    """A motion to a higher load in tension, or to a higher load in compression, which is negative."""

    do: Literal["to-load"]
    load_n: Signed
    rate_n_s: Positive
    images: LoadImages = LoadImages()

    def compile(self, draft: Draft) -> None:
        """Add the motion, and note the load that the specimen certainly carries."""
        move = draft.move_to("load", self.load_n, self.rate_n_s)
        plastic, load_n = None if self.until is None else self.until.plastic, abs(self.load_n)
        if plastic is not None:
            first_n = plastic.first_judged_n(self.images.every_n or 0.5 * load_n)
            draft.expect(min(load_n, first_n), plastic.judged_above_n)
        elif self.until is None:
            draft.expect(load_n)
        draft.add(self.approach(draft, move, self.load_n, self.images))
