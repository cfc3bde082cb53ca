"""Times of a camera's own clock, on the clock of the rig."""

from collections import deque
from dataclasses import dataclass

from drivers.cameras.genicam.nodes import Nodes
from drivers.clock import Clock
from drivers.errors import DeviceFault

DRIFT_MAX = 1e-4
"""Assumed largest difference in speed between the clocks of a camera and a computer."""
EVERY_S = 2.0
"""Time, in seconds, between two readings of a camera's clock."""
BASE_S = 10.0
"""From readings that are this far apart, in seconds, the difference in speed is computed."""
READINGS = 3
KEPT = 16
# command, value, and the number of its units in a second; None if the camera says the number
_LATCHES = (
    ("TimestampLatch", "TimestampLatchValue", 1e9),
    ("GevTimestampControlLatch", "GevTimestampValue", None),
)
_FREQUENCY = "GevTimestampTickFrequency"


@dataclass(frozen=True)
class Reading:
    """A reading of a camera's clock. On the rig's clock it was made at `rig_s`, give or take `half_s`."""

    camera_s: float
    rig_s: float
    half_s: float


class CameraClock:
    """Converts times of a camera's clock to the rig's clock, with a limit of their error.

    The camera's clock is read between two readings of the rig's clock, again and again. Nothing is assumed
    about the delay of frames on their way.
    """

    def __init__(self) -> None:
        self._readings: deque[Reading] = deque(maxlen=KEPT)

    @property
    def read_s(self) -> float:
        """Time of the last reading on the rig's clock, in seconds; -inf before the first one."""
        return self._readings[-1].rig_s if self._readings else -float("inf")

    def add(self, before_s: float, camera_s: float, after_s: float) -> None:
        """Add a reading of the camera's clock that was made between two times of the rig's clock.

        A camera whose clock went back was started anew, so earlier readings are forgotten.
        """
        if self._readings and camera_s <= self._readings[-1].camera_s:
            self._readings.clear()
        self._readings.append(Reading(camera_s, (before_s + after_s) / 2, (after_s - before_s) / 2))

    def on_rig(self, camera_s: float) -> tuple[float, float]:
        """Return a time on the rig's clock, and the largest possible error of it, both in seconds."""
        last = self._readings[-1]
        early = next((each for each in self._readings if last.rig_s - each.rig_s >= BASE_S), None)
        speed, doubt = 1.0, DRIFT_MAX
        if early is not None:
            apart_s = last.camera_s - early.camera_s
            speed = (last.rig_s - early.rig_s) / apart_s
            doubt = min(DRIFT_MAX, (last.half_s + early.half_s) / apart_s)
        since_s = camera_s - last.camera_s
        return last.rig_s + speed * since_s, last.half_s + doubt * abs(since_s)


class LatchedClock:
    """Reads the clock of an opened camera with the commands that the GenICam standard names.

    Raise `DeviceFault` if the camera has no such command.
    """

    def __init__(self, nodes: Nodes, device: str, clock: Clock) -> None:
        self._nodes = nodes
        self._clock = clock
        self.camera = CameraClock()
        for command, value, per_s in _LATCHES:
            if nodes.has(command) and nodes.has(value):
                self._command, self._value = command, value
                self._per_s = float(nodes.integer(_FREQUENCY)) if per_s is None else per_s
                break
        else:
            raise DeviceFault(
                device,
                "read the camera's clock",
                "TimestampLatch or GevTimestampControlLatch",
                "a camera with neither",
                'leave out `stamp`; the driver then takes "arrival"',
            )
        self.read()

    def read(self) -> None:
        """Read the camera's clock, and keep the reading that took the shortest time."""
        best: tuple[float, float, float] | None = None
        for _ in range(READINGS):
            before_s = self._clock.now_s()
            self._nodes.execute(self._command)
            after_s = self._clock.now_s()
            camera_s = self._nodes.integer(self._value) / self._per_s
            if best is None or after_s - before_s < best[2] - best[0]:
                best = before_s, camera_s, after_s
        assert best is not None
        self.camera.add(*best)

    def keep(self) -> None:
        """Read the camera's clock again if the last reading is old."""
        if self._clock.now_s() - self.camera.read_s > EVERY_S:
            self.read()
