"""The panel of the faults in pictures: each has its camera and its beginning."""

from collections.abc import Callable

from simulators.wire.faults import PICTURE, FaultPanel, parse


class PicturePanel(FaultPanel):
    """The faults of pictures, with texts ``NAME[:VALUE][:COUNT][@CAMERA]``; without CAMERA, of all cameras.

    `now_s` returns the time of the rig's clock. `cameras` holds the names of the cameras, as in the rig file
    without ``cameras.``; as long as it is empty, any name is accepted.
    """

    def __init__(self, now_s: Callable[[], float]) -> None:
        super().__init__(PICTURE)
        self.cameras: set[str] = set()
        self._now_s = now_s
        self._of: dict[str, tuple[str, float]] = {}

    def switch_on(self, text: str, since_s: float | None = None) -> None:
        """Switch on a fault, as of `since_s` on the rig's clock. Default: now.

        Raise `ValueError` for a malformed text, or a camera that does not exist.
        """
        fault, _, camera = text.strip().partition("@")
        self.require_camera(text)
        self._of[parse(fault)[0].name] = camera, self._now_s() if since_s is None else since_s
        super().switch_on(fault)

    def require_camera(self, text: str) -> None:
        """Raise `ValueError` if the text of a fault names a camera that does not exist."""
        _, at, camera = text.strip().partition("@")
        if at and (not camera or (self.cameras and camera not in self.cameras)):
            known = ", ".join(sorted(self.cameras)) or "the name of a camera"
            raise ValueError(f"fault {text!r}: expected one of {known} after @, got {camera!r}")

    def take_for(self, name: str, camera: str) -> str | None:
        """Return the value of a fault that is on for a camera, otherwise None. See `take`."""
        wanted, _ = self._of.get(name, ("", 0.0))
        return self.take(name) if wanted in ("", camera) else None

    def since_s(self, name: str) -> float:
        """Return the time at which a fault that is on was switched on."""
        return self._of[name][1]
