"""The phase `preload`: a small load under which the reference images are taken."""

from typing import Literal

from rig.protocol.draft import Draft, Phase, Positive, Signed
from rig.protocol.step import ProtocolStep


class Preload(Phase):
    """A small load under which the reference images are taken. Only the first phase may be a preload."""

    do: Literal["preload"]
    load_n: Signed
    rate_n_s: Positive

    def compile(self, draft: Draft) -> None:
        """Let the course begin with the load."""
        move = draft.move_to("load", self.load_n, self.rate_n_s)
        draft.push("load", self.load_n)
        if draft.number > 1:
            draft.mistake("only the first phase can be a preload; use to-load")
        draft.expect(abs(self.load_n))
        reference = ProtocolStep(
            1,
            "reference",
            self.load_n,
            move.tolerance,
            self.rate_n_s,
            travel=abs(self.load_n),
            motion_s=move.duration_s(abs(self.load_n)),
            load_drop="break" if self.load_n > 0.0 else "commanded",
        )
        draft.begin(reference)
