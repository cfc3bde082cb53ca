"""After a signal at any line of the engine, the rig is safe and the run file is closed."""

import signal
import sys
import threading
from collections.abc import Callable
from types import FrameType
from typing import Any

import h5py
import pytest

from rig.engine.signals import aborting_on_signals
from rig.protocol.rotation import RotationProtocol

SOURCES = (
    "drivers/clock.py",
    "rig/engine/calls.py",
    "rig/engine/devices.py",
    "rig/engine/engine.py",
    "rig/engine/listeners.py",
    "rig/engine/signals.py",
    "rig/engine/safety.py",
    "rig/engine/monitor.py",
    "rig/engine/settle.py",
    "rig/engine/imaging.py",
)
STRIDE = 421
"""Distance of the interrupted lines in the quick test; the long test interrupts many more lines."""


class Lines:
    """Counts the executed lines of the files in `SOURCES`, and calls `at_line` with each number."""

    def __init__(self, at_line: Callable[[int], None]) -> None:
        self._at_line = at_line
        self.count = 0

    def __enter__(self) -> "Lines":
        self._before = sys.gettrace()
        sys.settrace(self._trace)
        return self

    def __exit__(self, *_: object) -> None:
        sys.settrace(self._before)

    def _trace(self, frame: FrameType, event: str, _: Any) -> Any:
        if not frame.f_code.co_filename.endswith(SOURCES):
            return None
        if event == "line":
            self.count += 1
            self._at_line(self.count)
        return self._trace


@pytest.mark.parametrize(
    ("distance", "stride"),
    [
        (1, STRIDE),
        pytest.param(7, STRIDE, marks=pytest.mark.long),
        pytest.param(1, 53, marks=pytest.mark.long),
        pytest.param(7, 59, marks=pytest.mark.long),
    ],
)
def test_two_signals_at_any_line_end_the_run_safely(rotation, rotation_table, tmp_path, distance, stride):
    rotation_table["rotation"]["total_deg"] = rotation_table["rotation"]["increment_deg"]
    protocol = RotationProtocol.model_validate(rotation_table)

    def run(name: str, at_line: Callable[[int], None]) -> tuple[int, str, str]:
        rig = type(rotation)(protocol, tmp_path / name)
        engine = rig.engine()
        abort = engine.abort

        def note(reason: str) -> None:
            arrived.set()
            abort(reason)

        engine.abort = note  # type: ignore[method-assign]
        with aborting_on_signals(engine), Lines(at_line) as lines:
            outcome = engine.run()
        with h5py.File(rig.path) as file:
            assert file["entry/status"][()].decode() == outcome.status
        return lines.count, outcome.status, rig.calls[-1]

    arrived = threading.Event()
    total, status, _ = run("whole.h5", lambda line: None)
    assert status == "completed"
    for first in range(distance, total, stride):
        arrived.clear()

        def interrupt(line: int, first: int = first) -> None:
            if line in (first, first + distance):
                signal.raise_signal(signal.SIGINT)
                # The second is not waited for: the first may still wait for a lock of the interrupted line.
                assert arrived.wait(60.0)

        _, status, last_call = run(f"{first}.h5", interrupt)
        assert status == "completed" or (status, last_call) == ("aborted", "stop"), f"line {first}"
