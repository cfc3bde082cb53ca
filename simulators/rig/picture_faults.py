"""Faults of the pictures that the simulated cameras take. No driver can notice these faults."""

import math
import threading
from dataclasses import dataclass, replace

import numpy as np

from drivers.clock import Clock
from drivers.errors import LinkLost
from simulators.rig.light import COVER_EDGE_PX, UNDER_COVER, Light
from simulators.rig.picture_panel import PicturePanel
from simulators.scene.optics import PinholeCamera
from simulators.scene.pose import Pose
from simulators.scene.scene import Surface
from simulators.scene.torn import Torn

FLICKER_HZ = 100.0
GLARE_START_PX = 20.0
_OF_LIGHT = ("light", "flicker", "cover", "glare", "defocus", "blur")
_OF_SURFACE = ("tear", "creep", "roll")


@dataclass(frozen=True)
class Taken:
    """An exposure: the camera's name, the frame's number, and the true beginning and length in seconds."""

    camera: str
    sequence: int
    begins_s: float
    exposure_s: float

    @property
    def end_s(self) -> float:
        """The end of the exposure, on the rig's clock."""
        return self.begins_s + self.exposure_s


@dataclass(frozen=True)
class FirstPicture:
    """The first exposure of a camera that shows a fault, or that is missing because of it.

    Attributes
    ----------
    fault : str
    since_s : float
        Time at which the fault began, on the rig's clock.
    taken : Taken
    """

    fault: str
    since_s: float
    taken: Taken


class PictureFaults:
    """Changes what the cameras see, and makes cameras unreachable for a time.

    `clock` is the clock of the rig, which determines when an unreachable camera becomes reachable again.
    The faults are switched on the attribute `panel`. The list `first` has an entry for each fault and each
    camera, once its first picture with the fault is exposed. `glare_at` is the middle of the glare as a part
    of the image's width and height, and the tear begins at the material line Y = `crack_y_mm`.
    """

    def __init__(self, clock: Clock) -> None:
        self.panel = PicturePanel(clock.now_s)
        self.first: list[FirstPicture] = []
        self.glare_at = (0.5, 0.5)
        self.crack_y_mm = 0.0
        self._clock = clock
        self._lock = threading.Lock()
        self._told: set[tuple[str, str, float]] = set()
        self._absent_until_s: dict[str, float] = {}

    def frozen(self, camera: str) -> bool:
        """Return True if the next frame of a camera shows the same picture as the previous frame."""
        return self.panel.take_for("frozen", camera) is not None

    def seen(self, camera: str, optics: PinholeCamera, surface: Surface, time_s: float) -> Surface:
        """Return what a camera sees of a surface at a time: torn, or from where the camera has moved."""
        rates = {name: float(value) for name in _OF_SURFACE if (value := self.panel.take_for(name, camera))}
        gone = {
            name: rate * 1e-3 * max(0.0, time_s - self.panel.since_s(name)) for name, rate in rates.items()
        }
        if gone.get("tear"):
            surface = replace(surface, texture=Torn(surface.texture, self.crack_y_mm, gone["tear"]))
        # The scene moves by the opposite of the camera's motion.
        _, up, back = optics.axes
        if gone.get("creep"):
            surface = replace(surface, pose=Pose(translation_mm=-gone["creep"] * up).after(surface.pose))
        if gone.get("roll"):
            surface = replace(surface, pose=Pose.turned(back, -gone["roll"], np.zeros(3)).after(surface.pose))
        return surface

    def light(self, taken: Taken, height_px: int) -> tuple[Light, tuple[str, ...]]:
        """Return what happens to the light of one exposure, and the names of the faults that it shows."""
        found = {name: self.panel.take_for(name, taken.camera) for name in (*_OF_LIGHT, *_OF_SURFACE)}
        values = {name: float(value) for name, value in found.items() if value is not None}
        ages_s = {name: taken.end_s - self.panel.since_s(name) for name in values}
        shown = tuple(name for name, age_s in ages_s.items() if age_s > 0.0)
        for name in shown:
            self.note(name, taken)
        factor, covered_px, glare_px = 1.0, 0.0, 0.0
        if "light" in values:
            factor = values["light"] / 100.0
        if "flicker" in shown:
            factor *= 1.0 + values["flicker"] / 100.0 * _mean_of_sine(taken.begins_s, taken.exposure_s)
        if "cover" in shown and values["cover"] == 0.0:
            factor *= 1.0 - (1.0 - UNDER_COVER) * min(1.0, ages_s["cover"] / taken.exposure_s)
        elif "cover" in shown:
            covered_px = (height_px + COVER_EDGE_PX) * ages_s["cover"] / values["cover"]
        if "glare" in shown:
            glare_px = GLARE_START_PX + values["glare"] * ages_s["glare"]
        x, y = self.glare_at
        smear_px, defocus_px = values.get("blur", 0.0), values.get("defocus", 0.0)
        return Light(factor, covered_px, glare_px, x, y, defocus_px, smear_px), shown

    def note(self, fault: str, taken: Taken, since_s: float | None = None) -> None:
        """Note a fault that an exposure shows, or that makes it missing, if it is the camera's first one.

        `since_s` is the beginning of a fault that is not on the panel.
        """
        began_s = self.panel.since_s(fault) if since_s is None else since_s
        with self._lock:
            if (fault, taken.camera, began_s) not in self._told:
                self._told.add((fault, taken.camera, began_s))
                self.first.append(FirstPicture(fault, began_s, taken))

    def require_present(self, name: str, step: str) -> None:
        """Raise `LinkLost` while the camera `name` is unreachable.

        The camera becomes unreachable at the first call with the fault switched on.
        """
        camera = name.removeprefix("cameras.")
        absent_s = self.panel.take_for("dropout", camera) if step in ("grab", "stream") else None
        if absent_s is not None:
            self._absent_until_s[name] = self._clock.now_s() + float(absent_s)
        if self._clock.now_s() < self._absent_until_s.get(name, -np.inf):
            raise LinkLost(
                name, step, "a camera on its cable", "none", "plug the camera in and open it again"
            )


def _mean_of_sine(begins_s: float, length_s: float) -> float:
    """Return the mean of the lamps' oscillation, of amplitude 1, over an exposure."""
    rate = 2.0 * math.pi * FLICKER_HZ
    return (math.cos(rate * begins_s) - math.cos(rate * (begins_s + length_s))) / (rate * length_s)
