"""The operator of a simulated rig, who attaches the grid to the specimen and removes the grid."""

from collections.abc import Callable
from typing import TYPE_CHECKING, TypeAlias

from pydantic import Field

from drivers.clock import Clock
from drivers.interfaces import OpenContext, OperatorAction, OperatorQuestion
from drivers.registry import DriverSpec
from drivers.settings import Settings

if TYPE_CHECKING:
    from simulators.scene.scene import Scene


class OperatorSettings(Settings):
    """Duration of the operator's actions."""

    duration_s: float = Field(default=60.0, ge=0, le=3600, description="time to attach or remove the grid")


Asked: TypeAlias = OperatorAction | OperatorQuestion
"""What an operator is asked: an action, or a question of the protocol."""


def notice(asked: Asked, duration_s: float) -> str:
    """Return a sentence on the action of a simulated operator and its duration."""
    return f"simulated operator: {said(asked)}, {duration_s:g} s"


def said(asked: Asked) -> str:
    """Return what a simulated operator does: the action, or the answer to a question."""
    if isinstance(asked, OperatorAction):
        return asked.value
    return f'{asked.text} Answers "{asked.word}"'


class SimulatedOperator:
    """A simulated operator, who needs the set duration for each action.

    `on_action` is called with two arguments: the action, and False at its beginning or True at its end.
    """

    def __init__(
        self,
        scene: "Scene",
        clock: Clock,
        duration_s: float,
        on_action: Callable[[Asked, bool], None] = lambda action, done: None,
    ) -> None:
        self._scene = scene
        self._clock = clock
        self._duration_s = duration_s
        self._on_action = on_action

    def notice(self, action: Asked) -> str:
        """Return a sentence on the operator's action and its duration."""
        return notice(action, self._duration_s)

    def perform(self, action: OperatorAction) -> None:
        """Attach or remove the grid; return after the set duration."""
        self._on_action(action, False)
        self._clock.sleep(self._duration_s)
        if action is not OperatorAction.GO_ON:
            self._scene.grid_attached = action is OperatorAction.ATTACH_GRID
        self._on_action(action, True)

    def ask(self, question: OperatorQuestion) -> None:
        """Answer a question of the protocol; return after the set duration."""
        self._on_action(question, False)
        self._clock.sleep(self._duration_s)
        self._on_action(question, True)

    def withdraw(self) -> None:
        """Do nothing, because a simulated operator waits for nobody."""


def _open(settings: OperatorSettings, context: OpenContext) -> SimulatedOperator:
    # Import here: the scene loads numba, which is not needed if another program simulates the rig.
    from simulators.scene.scene import scene_of

    return SimulatedOperator(scene_of(context), context.clock, settings.duration_s)


SPEC = DriverSpec("operator", OperatorSettings, _open)
