"""A run that ended early is continued in a new run file."""

import json
import signal
import threading
from collections.abc import Callable
from pathlib import Path

import pytest

import dic
from dic.correlation.settings import CorrelationSettings
from dic.errors import RunFileError
from dic.files.digest import file_sha256
from dic.runfile.joined import open_run
from dic.runfile.reader import RunFile
from drivers.interfaces import OperatorAction
from rig.commands.continuing import next_segment
from rig.commands.verify import verify_run
from rig.engine.engine import Engine
from rig.news.run_news import NewsOptions
from rig.protocol.protocol import read_protocol
from rig.protocol.step import RigReading
from rig.resume import ContinueError, read_earlier, require_unchanged
from rig.run import run_protocol
from tests.places import example, small_cameras
from tests.rig.conftest import FakeRig


def files(tmp_path: Path) -> tuple[Path, Path]:
    protocol, rig_path = tmp_path / "protocol.toml", tmp_path / "rig.toml"
    protocol.write_text(example("rotation", ("increment_deg = 22.5", "increment_deg = 90.0")))
    rig_path.write_text(example("rig-virtual-rotation-10", small_cameras(450, 1400.0)))
    return protocol, rig_path


@pytest.fixture
def interrupt_at(at_step, monkeypatch) -> Callable[[int | None], None]:
    """A function `interrupt_at(index)`: a signal ends the run after this step was given to the recorder.

    After `interrupt_at(None)`, no step is interrupted any more.
    """
    abort, told = Engine.abort, threading.Event()

    def note(engine: Engine, reason: str) -> None:
        abort(engine, reason)
        told.set()

    def interrupt() -> None:
        told.clear()
        signal.raise_signal(signal.SIGINT)
        # A thread of its own hands the signal on, and simulated time would go on without it.
        assert told.wait(60.0)

    monkeypatch.setattr(Engine, "abort", note)
    return lambda index: at_step(index, interrupt)


def interrupted(tmp_path: Path) -> tuple[Path, Path, Path]:
    protocol, rig_path = files(tmp_path)
    path = tmp_path / "run.h5"
    assert run_protocol(protocol, rig_path, path).status == "aborted"
    return protocol, rig_path, path


def test_a_rotation_goes_on_from_its_finished_steps(tmp_path, interrupt_at):
    interrupt_at(3)
    protocol, rig_path, path = interrupted(tmp_path)
    digest = file_sha256(path)
    with RunFile(path) as run:
        finished = [step.index for step in run.steps]
    assert finished == [0, 1, 2, 3]
    told: list[tuple[int, RigReading]] = []
    new = next_segment(path)
    outcome = run_protocol(
        protocol,
        rig_path,
        new,
        continues=path,
        news=NewsOptions(on_continue=lambda earlier, start: told.append((earlier.next.index, start))),
    )
    states = [json.loads(line) for line in new.with_suffix(".events.jsonl").read_text().splitlines()]
    finished_of = [each["steps_before"] + each["steps_done"] for each in states if each["event"] == "state"]
    assert (finished_of[0], finished_of[-1]) == (len(finished), 6)
    assert outcome.status == "completed", outcome.reason
    assert told[0][0] == len(finished)
    assert file_sha256(path) == digest
    with RunFile(new) as run:
        assert [step.index for step in run.steps] == list(range(len(finished), 6))
        assert run.continues is not None
        assert (run.continues["file"], run.continues["sha256"]) == ("run.h5", digest)
        assert run.continues["steps"] == finished
    assert verify_run(new).problems == []
    with open_run(new) as joined:
        assert [step.kind for step in joined.steps] == ["grid", "reference", *["rotation"] * 4]
        assert joined.image("on_axis", joined.steps[2]).shape == (450, 450)
    result = dic.process_run(new, CorrelationSettings(step_px=40))
    for camera in result.cameras:
        assert [step.index for step in camera.steps] == [2, 3, 4, 5]
        assert camera.failures == []
        # a rotation strains nothing
        assert all(abs(m.mean.exx) < 5e-3 for m in camera.measurements)


@pytest.mark.extended
def test_a_run_that_went_on_goes_on_again(tmp_path, interrupt_at):
    protocol, rig_path = files(tmp_path)
    rig_path.write_text(rig_path.read_text().replace("450", "64"))
    paths = [tmp_path / name for name in ("run.h5", "run-2.h5", "run-3.h5")]
    for path, before, last in zip(paths, [None, *paths[:2]], [2, 3, None], strict=True):
        interrupt_at(last)
        outcome = run_protocol(protocol, rig_path, path, continues=before)
        assert outcome.status == ("aborted" if last else "completed"), outcome.reason
    with RunFile(paths[2]) as run:
        assert run.continues is not None
        finished = run.continues["steps"]
        own = [step.index for step in run.steps]
    assert (finished, own) == ([0, 1, 2, 3], [4, 5])
    assert verify_run(paths[2]).problems == []
    with open_run(paths[2]) as joined:
        assert [step.index for step in joined.steps] == list(range(6))
    # the oldest file is needed too
    paths[0].chmod(0o644)
    paths[0].write_bytes(paths[0].read_bytes()[:-1])
    with pytest.raises(RunFileError, match="copy the earlier run file into the same folder, unchanged"):
        read_earlier(paths[1], protocol.read_text(), rig_path.read_text())


def refusal(tmp_path: Path, change: Callable[[Path, Path, Path], None]) -> str:
    protocol, rig_path, path = interrupted(tmp_path)
    change(protocol, rig_path, path)
    with pytest.raises((ContinueError, RunFileError)) as caught:
        run_protocol(protocol, rig_path, tmp_path / "new.h5", continues=path)
    assert not (tmp_path / "new.h5").exists()
    return str(caught.value)


def edit(path: Path, old: str, new: str) -> None:
    path.chmod(0o644)
    path.write_text(path.read_text().replace(old, new))


def damage(path: Path) -> None:
    path.chmod(0o644)
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 0xFF
    path.write_bytes(content)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda protocol, rig, run: edit(protocol, "dwell_s = 0.5", "dwell_s = 0.6"), "the protocol of the"),
        pytest.param(
            lambda protocol, rig, run: edit(rig, "seed = 1", "seed = 2"),
            "the rig file of the earlier run",
            marks=pytest.mark.extended,
        ),
        (lambda protocol, rig, run: damage(run), "expected a verified run file"),
    ],
)
def test_another_protocol_another_rig_and_a_damaged_file_are_refused(tmp_path, interrupt_at, change, said):
    interrupt_at(2)
    assert said in refusal(tmp_path, change)


def test_a_completed_run_is_refused(tmp_path):
    protocol, rig_path = files(tmp_path)
    path = tmp_path / "run.h5"
    assert run_protocol(protocol, rig_path, path).status == "completed"
    with pytest.raises(ContinueError, match="got a completed one"):
        run_protocol(protocol, rig_path, tmp_path / "new.h5", continues=path)


@pytest.fixture
def stopped(tmp_path) -> FakeRig:
    """A tension test on simple simulated devices, aborted in its third load increment, at 4.9 kN."""
    definition = example("tension")
    path = tmp_path / "protocol.toml"
    path.write_text(definition)
    rig = FakeRig(read_protocol(path), tmp_path / "run.h5", definition=definition)
    engine = rig.engine()

    def abort(count, state):
        if state.load_n > 4900.0:
            engine.abort("the abort button")
        return state

    # In the machine's own reading: a listener would be told some moment later, at another load in each run.
    rig.load_frame.on_read = abort
    assert engine.run().status == "aborted"
    rig.load_frame.on_read = lambda count, state: state
    rig.calls.clear()
    return rig


def go_on(rig: FakeRig):
    earlier = read_earlier(rig.path, rig.definition, "")
    rig.path = rig.path.with_name("run-2.h5")
    engine = rig.engine(earlier=earlier.readings)
    start = require_unchanged(earlier, rig.protocol, engine.context.rig)
    return earlier, start, engine


def test_tension_goes_on_only_at_the_operators_word_and_without_a_new_zero(stopped):
    earlier, start, engine = go_on(stopped)
    assert start.load_n == pytest.approx(earlier.end.load_n, abs=1.0)
    outcome = engine.run()
    assert outcome.status == "completed", outcome.reason
    assert "tare" not in stopped.calls
    assert "ATTACH_GRID" not in stopped.calls
    asked = stopped.calls.index(OperatorAction.GO_ON.name)
    assert not any(call.startswith(("load", "displacement")) for call in stopped.calls[:asked])
    first = next(call for call in stopped.calls[asked:] if call.startswith("load"))
    assert first == f"load {earlier.next.target:g}"
    record = json.loads(earlier.record(start))
    assert record["ended"]["load_n"] == earlier.end.load_n
    assert record["begins"]["displacement_mm"] == start.displacement_mm


@pytest.mark.parametrize(
    ("name", "change", "said"),
    [("displacement_mm", 0.0125, "displacement: expected"), ("zero_n", 2000.0, "load: expected")],
)
def test_a_machine_that_stands_elsewhere_is_refused(stopped, name, change, said):
    # 0.0125 mm are above the limit of 0.005 mm, and the 220 N that belong to them below a tenth of 4.9 kN.
    setattr(stopped.load_frame, name, getattr(stopped.load_frame, name) + change)
    with pytest.raises(ContinueError, match=said):
        go_on(stopped)


def test_another_camera_is_refused(stopped):
    for camera in stopped.cameras.values():
        camera.info = type(camera.info)(**{**camera.info.__dict__, "serial": "another"})
    with pytest.raises(ContinueError, match="connect the device of the earlier run"):
        go_on(stopped)


def test_segments_are_numbered():
    assert next_segment(Path("a/run.h5")) == Path("a/run-2.h5")
    assert next_segment(Path("run-2.h5")) == Path("run-3.h5")
