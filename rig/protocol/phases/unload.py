"""The phase `unload`: a motion back to a lower load, in tension or in compression."""

from dataclasses import dataclass
from typing import Literal

from pydantic import Field

from rig.protocol.approach import Approach
from rig.protocol.course import Positions
from rig.protocol.draft import Draft, Phase
from rig.protocol.phases.motion import LoadImages, approach
from rig.protocol.step import Execute, ProtocolStep, RigReading


class Unload(Phase):
    """A motion back to a load that is nearer to zero. It is left out if the load is nearer already."""

    do: Literal["unload"]
    load_n: float = 0.0
    rate_n_s: float = Field(gt=0.0)
    images: LoadImages = LoadImages()

    def compile(self, draft: Draft) -> None:
        """Add the motion."""
        move, span = draft.move_to("load", self.load_n, self.rate_n_s), draft.place.load
        draft.push("load", self.load_n)
        in_compression = span.high <= 0.0 and span.is_known
        if span.low < 0.0 and not in_compression and self.load_n == 0.0:
            # Only the readings tell whether the specimen is in tension or in compression.
            down, up = (approach(draft, move, 0.0, self.images, down=way) for way in (True, False))
            draft.add(EitherWay(down, up))
            return
        in_compression = in_compression or self.load_n < 0.0
        draft.add(approach(draft, move, self.load_n, self.images, down=not in_compression))


@dataclass(frozen=True)
class EitherWay:
    """The part of a course that unloads a specimen which is in tension or in compression."""

    down: Approach
    up: Approach

    def steps(self, index: int, place: Positions) -> list[ProtocolStep]:
        """Return the steps from the load that is farther from zero."""
        return max((part.steps(index, place) for part in (self.down, self.up)), key=len)

    def follow(
        self, index: int, place: Positions, reading: RigReading | None, execute: Execute
    ) -> RigReading:
        """Execute the steps from the actual load to zero."""
        assert reading is not None
        part = self.down if reading.load_n >= 0.0 else self.up
        return part.follow(index, place, reading, execute)

    def end(self, place: Positions) -> Positions:
        """Return the possible positions after the motion."""
        return self.down.end(place)
