"""What a simulated camera has around it: the faults of the rig, and the way in which pictures are drawn."""

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self

from pydantic import Field

from drivers.clock import Clock
from drivers.errors import DeviceFault
from drivers.interfaces import OpenContext
from drivers.settings import Settings
from simulators.rig.camera_settings import CameraSettings
from simulators.rig.painters import ExactPainter, Painter, PreparedPainter
from simulators.rig.picture_faults import PictureFaults
from simulators.rig.picture_store import PictureStore
from simulators.rig.planned_faults import PlannedFaults
from simulators.scene.prepared import MARGIN_PX, can_prepare
from simulators.scene.scene import Scene
from simulators.wire.faults import CAMERA, FaultPanel
from simulators.wire.rig_faults import RigFaults


class PreparedSettings(Settings):
    """The table [simulation.prepared]: frames are drawn fast, from pictures that are prepared beforehand."""

    margin_px: int = Field(
        default=160,
        ge=MARGIN_PX,
        le=2000,
        description="what a picture shows beyond each side of the image; a longer motion needs a new picture",
    )
    folder: str | None = Field(
        default=None,
        min_length=1,
        description="folder in which pictures are kept for the next run; default: memory only",
    )


@dataclass
class Surroundings:
    """The faults of a camera, of the pictures, and those that are planned; and how pictures are drawn.

    `prepared` is None for pictures that are drawn exactly. `say` is called with lines about the preparation.
    """

    faults: FaultPanel
    pictures: PictureFaults
    plan: PlannedFaults
    prepared: PreparedSettings | None = None
    say: Callable[[str], None] = field(default=lambda line: None)

    @classmethod
    def of(
        cls,
        clock: Clock,
        faults: FaultPanel | None = None,
        pictures: PictureFaults | None = None,
        **options: Any,
    ) -> Self:
        """Return the surroundings of a camera alone."""
        faults, pictures = faults or FaultPanel(CAMERA), pictures or PictureFaults(clock)
        plan = PlannedFaults([], RigFaults(faults, pictures.panel), pictures, clock.now_s())
        return cls(faults, pictures, plan, **options)

    @classmethod
    def found(cls, context: OpenContext) -> "Surroundings":
        """Return the surroundings that a rig gives its cameras, and make the camera's name known to them."""
        around = getattr(context.environment, "around_cameras", None)
        if not isinstance(around, Surroundings):
            return cls.of(context.clock)
        around.pictures.panel.cameras.add(context.name.removeprefix("cameras."))
        return around

    def painter(self, settings: CameraSettings, scene: Scene, name: str) -> Painter:
        """Return what draws the pictures of a camera. Raise `DeviceFault` if they cannot be prepared."""
        if self.prepared is None:
            return ExactPainter(settings, scene.seed, name)
        margin_px, folder = self.prepared.margin_px, self.prepared.folder
        if not can_prepare(settings.optics(), margin_px):
            raise DeviceFault(
                name,
                "prepare pictures",
                "a lens that sees the specimen's plane beyond the image",
                f"one that does not see it {margin_px} px beyond a corner",
                "lower margin_px in [simulation.prepared], or take another lens",
            )
        store = None if folder is None else PictureStore(Path(folder))
        painter = PreparedPainter(settings, scene.seed, name, margin_px, store, self.say)
        for grid in (True, False):
            painter.prepare(scene.surface_with(grid=grid))
        return painter
