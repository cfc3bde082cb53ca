"""Give images and steps to the recorder, and monitor the devices while the disk is busy."""

from drivers.interfaces import Frame
from rig.engine.calls import Deadline
from rig.engine.context import RunContext
from rig.recorder import StepRecord
from rig.recorder.records import STEP_ON_FILE

ON_FILE = Deadline(60.0, "check the disk that holds the run file")
"""Longest wait until an image or step is on the disk. The recorder reports a slow disk earlier."""


def record_frame(run: RunContext, camera: str, frame: Frame, keep_s: float | None = None) -> int:
    """Record an image and return its row. First wait while too many images of its camera are waiting.

    `keep_s` is described for `Recorder.frame`.
    """
    recorder = run.recorder
    if not recorder.wait_for_room(camera, 0.0):
        action = f"wait for the images of {camera}"
        run.finish(
            run.calls.begin(
                "run file", action, lambda: recorder.wait_for_room(camera, ON_FILE.duration_s), ON_FILE
            )
        )
    return recorder.frame(camera, frame, keep_s)


def record_step(run: RunContext, record: StepRecord) -> None:
    """Record a step, and return when it is on the disk."""
    written = run.recorder.step(record)
    run.finish(run.calls.follow(written, "run file", f"write {record.step}", ON_FILE))
    run.mark(STEP_ON_FILE)
