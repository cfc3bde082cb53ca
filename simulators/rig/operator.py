"""The person at a simulated rig: attaches the grid to the specimen and takes it off again."""

from pydantic import Field

from drivers.clock import Clock
from drivers.interfaces import OpenContext, OperatorAction
from drivers.registry import DriverSpec
from drivers.settings import Settings
from simulators.scene.scene import Scene, scene_of


class OperatorSettings(Settings):
    """Durations of the person's actions."""

    duration_s: float = Field(default=60.0, ge=0, le=3600, description="time to attach or remove the grid")


class SimulatedOperator:
    """Carries out requests with realistic durations."""

    def __init__(self, scene: Scene, clock: Clock, duration_s: float) -> None:
        self._scene = scene
        self._clock = clock
        self._duration_s = duration_s

    def perform(self, action: OperatorAction) -> None:
        """Attach or remove the grid; return when it is done."""
        self._clock.sleep(self._duration_s)
        self._scene.grid_attached = action is OperatorAction.ATTACH_GRID


def _open(settings: OperatorSettings, context: OpenContext) -> SimulatedOperator:
    return SimulatedOperator(scene_of(context), context.clock, settings.duration_s)


SPEC = DriverSpec("operator", OperatorSettings, _open)
