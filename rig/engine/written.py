"""Steps that the recorder is writing while the engine goes on."""

from collections import deque
from collections.abc import Callable
from concurrent.futures import Future

from drivers.clock import SystemClock
from rig.engine.context import RunContext
from rig.engine.filing import ON_FILE
from rig.errors import RecordingError
from rig.recorder import StepRecord


class WrittenSteps:
    """The steps that were given to the recorder and are not on the disk yet.

    `filed` is called with each step that is on the disk, in their order.
    """

    def __init__(self, run: RunContext, filed: Callable[[StepRecord], None]) -> None:
        self._run, self._filed = run, filed
        # The disk is real, also in a simulated run, whose time may pass much faster.
        self._clock = SystemClock()
        self._writing: deque[tuple[StepRecord, Future[None], float]] = deque()

    def add(self, record: StepRecord) -> None:
        """Give a step to the recorder, and return at once."""
        self._writing.append((record, self._run.recorder.step(record), self._clock.now_s()))

    def check(self) -> None:
        """Tell of the steps that are on the disk. Raise `RecordingError` if the disk is too slow."""
        while self._writing:
            record, written, since_s = self._writing[0]
            if not written.done():
                if self._clock.now_s() - since_s > ON_FILE.duration_s:
                    raise RecordingError(
                        str(self._run.recorder.path),
                        f"{record.step} on the disk within {ON_FILE.duration_s:g} s",
                        "none",
                        ON_FILE.remedy,
                    )
                return
            written.result()
            self._writing.popleft()
            self._filed(record)

    def finish(self) -> None:
        """Wait until all steps are on the disk, and tell of them."""
        run = self._run
        while self._writing:
            record, written, _ = self._writing[0]
            run.finish(run.calls.follow(written, "run file", f"write {record.step}", ON_FILE))
            self.check()
