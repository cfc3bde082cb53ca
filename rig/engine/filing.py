"""Give images and steps to the recorder, and monitor the devices while the disk is busy."""

from collections.abc import Callable

from drivers.interfaces import Frame
from rig.engine.calls import Calls, Deadline
from rig.recorder import Recorder, StepRecord

ON_FILE = Deadline(60.0, "check the disk that holds the run file")
"""Longest wait until an image or step is on the disk. The recorder reports a slow disk earlier."""


class Filing:
    """Records the images, steps and events for which the engine must wait.

    Parameters
    ----------
    recorder : Recorder
    calls : Calls
    meanwhile : callable
    every_s : float
        These parameters are described for `Calls.finish`.
    """

    def __init__(
        self, recorder: Recorder, calls: Calls, meanwhile: Callable[[], object], every_s: float
    ) -> None:
        self._recorder = recorder
        self._calls = calls
        self._meanwhile = meanwhile
        self._every_s = every_s

    def frame(self, camera: str, frame: Frame) -> int:
        """Record an image and return its row. First wait while too many images of its camera are waiting."""
        if not self._recorder.wait_for_room(camera, 0.0):
            room = self._calls.begin(
                "run file",
                f"wait for the images of {camera}",
                lambda: self._recorder.wait_for_room(camera, ON_FILE.duration_s),
                ON_FILE,
            )
            self._calls.finish(room, meanwhile=self._meanwhile, every_s=self._every_s)
        return self._recorder.frame(camera, frame)

    def step(self, record: StepRecord) -> None:
        """Record a step, and return when it is on the disk."""
        written = self._calls.follow(self._recorder.step(record), "run file", f"write {record.step}", ON_FILE)
        self._calls.finish(written, meanwhile=self._meanwhile, every_s=self._every_s)

    def mark(self, time_s: float, message: str) -> None:
        """Record an event at the end of a wait, so that a replay can count the readings during the wait."""
        self._recorder.event(time_s, "info", "engine", message)
