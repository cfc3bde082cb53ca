"""If any call of a driver never returns, at any time, the run ends in its safe state."""

import threading
from collections.abc import Callable
from concurrent.futures import Future
from contextlib import closing
from typing import Any

import pytest

from drivers.errors import DeviceFault, DeviceTimeout
from drivers.interfaces import StageState
from rig.devices import Rig
from rig.engine.calls import Calls
from rig.engine.devices import Devices, called
from rig.engine.status import State
from rig.recorder import StepRecord
from rig.rigfile import CALL_TIMEOUT_S
from tests.rig.conftest import FakeRig, in_real_time

LONG_S = 1e6


def hang_in(rig: FakeRig, device: Any, call: str, at: int) -> list[float]:
    """Make call number `at` of a method hang; return a list to which the time of this call is added."""
    called, hung_s, made = 0, [], getattr(device, call)

    def hanging(*arguments: Any) -> Any:
        nonlocal called
        called += 1
        if called == at:
            hung_s.append(rig.clock.now_s())
            rig.clock.sleep(LONG_S)
        return made(*arguments)

    setattr(device, call, hanging)
    return hung_s


def note_stop(rig: FakeRig, device: Any, call: str) -> list[float]:
    stopped_s, made = [], getattr(device, call)

    def stopping() -> None:
        stopped_s.append(rig.clock.now_s())
        made()

    setattr(device, call, stopping)
    return stopped_s


@pytest.mark.parametrize("at", [1, 40, 150])
def test_reading_that_hangs_ends_in_a_hold_within_its_deadline(tension, at):
    hung_s = hang_in(tension, tension.load_frame, "read", at)
    stopped_s = note_stop(tension, tension.load_frame, "hold")
    outcome = tension.engine().run()
    assert outcome.status == "failed"
    assert "load_frame: read: expected the end of the call within 0.7 s, got none" in outcome.reason
    assert "raise call_timeout_s in [rig] above 0.7" in outcome.reason
    assert stopped_s[-1] - hung_s[0] == pytest.approx(CALL_TIMEOUT_S)
    (lost,) = outcome.lost_devices
    assert lost.startswith("load_frame: its driver hangs in read, which has not returned for 0.7 s")
    assert (outcome.unsafe, tension.states[-2:]) == ((), ["SAFING", "FAILED"])


@pytest.mark.parametrize(
    ("call", "at", "said"),
    [("go_to_load", 2, "go to 4000 N"), ("go_to_displacement", 1, "go to 2.35"), ("tare", 1, "tare")],
)
def test_command_of_the_frame_that_hangs_ends_in_a_hold_within_its_deadline(tension, call, at, said):
    hung_s = hang_in(tension, tension.load_frame, call, at)
    stopped_s = note_stop(tension, tension.load_frame, "hold")
    outcome = tension.engine().run()
    assert f"load_frame: {said}" in outcome.reason
    assert stopped_s[-1] - hung_s[0] == pytest.approx(CALL_TIMEOUT_S)


@pytest.mark.parametrize(
    ("call", "at"), [("read", 1), ("read", 30), ("home", 1), ("move_to", 1), ("move_to", 4)]
)
def test_call_of_the_stage_that_hangs_ends_in_a_stop_within_its_deadline(rotation, call, at):
    hung_s = hang_in(rotation, rotation.stage, call, at)
    stopped_s = note_stop(rotation, rotation.stage, "stop")
    outcome = rotation.engine().run()
    assert (outcome.status, outcome.unsafe) == ("failed", ())
    assert stopped_s[-1] - hung_s[0] == pytest.approx(CALL_TIMEOUT_S)
    assert outcome.lost_devices[0].startswith("stage: its driver hangs in")


def test_hold_before_the_operator_is_asked_may_take_as_long_as_a_driver_repeats_it(tension):
    """The hold of the safe state, on a thread of its own, is tried all the same."""
    hang_in(tension, tension.load_frame, "hold", 1)
    outcome = tension.engine().run()
    assert "load_frame: hold: expected the end of the call within 6 s" in outcome.reason
    assert tension.clock.now_s() == pytest.approx(6.0, abs=0.5)
    assert tension.calls == ["hold"]


def test_camera_that_hangs_is_given_up_and_the_frame_is_watched_meanwhile(tension):
    hung_s = hang_in(tension, tension.cameras["off_axis"], "grab", 3)
    read_s, made = [], tension.load_frame.read
    tension.load_frame.read = lambda: read_s.append(tension.clock.now_s()) or made()
    outcome = tension.engine().run()
    # images.timeout_s and its margin
    assert "cameras.off_axis: grab: expected the end of the call within 7 s" in outcome.reason
    meanwhile = [time_s for time_s in read_s if time_s > hung_s[0]]
    assert len(meanwhile) == pytest.approx(7.0 / tension.protocol.settle.poll_s, abs=1)
    assert outcome.lost_devices[0].startswith("cameras.off_axis: its driver hangs in grab")


def take_time(rig: FakeRig, busy: dict[str, float]) -> Callable[..., Any]:
    """Return a function that takes 4 s of the rig's time, and records its start and end in `busy`."""

    def slowly(*arguments: Any) -> Any:
        busy["from_s"] = rig.clock.now_s()
        rig.clock.sleep(4.0)
        busy["to_s"] = rig.clock.now_s()
        return arguments[-1]

    return slowly


@pytest.mark.parametrize("who", ["camera", "operator"])
@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"load_n": 13500.0}, "expected a load within 13000 N"),
        ({"displacement_mm": 5.5}, "expected a displacement within 5.2 mm"),
        ({"faults": ("e-stop",)}, "expected no fault, got e-stop"),
    ],
)
def test_limits_and_faults_are_watched_while_a_camera_or_the_operator_takes_time(
    tension, who, on_frame_state, changes, said
):
    busy: dict[str, float] = {}
    if who == "camera":
        tension.cameras["on_axis"].on_grab = take_time(tension, busy)
    else:
        tension.operator.on_perform = take_time(tension, busy)
    changed = on_frame_state(0, **changes)
    tension.load_frame.on_read = lambda count, state: changed(count, state) if busy else state
    stopped_s = note_stop(tension, tension.load_frame, "hold")
    outcome = tension.engine().run()
    assert (outcome.status, said in outcome.reason) == ("failed", True)
    assert stopped_s[-1] - busy["from_s"] <= tension.protocol.settle.poll_s
    assert "to_s" not in busy


def test_frame_that_does_not_answer_ends_the_run_while_the_operator_is_asked(tension):
    def lose(count, state):
        if "ATTACH_GRID" in tension.calls:
            raise DeviceTimeout("load_frame", "read", "an answer", "silence", "check the cable")
        return state

    tension.load_frame.on_read = lose
    tension.operator.on_perform = lambda action: tension.clock.sleep(LONG_S)
    outcome = tension.engine().run()
    assert (outcome.status, outcome.lost_devices) == ("failed", ())
    assert "got silence" in outcome.reason


@pytest.mark.parametrize("state", [State.PREPARING, State.IMAGING])
def test_abort_ends_the_wait_for_a_person_and_for_a_camera(tension, state):
    over = threading.Event()

    def never(*_: Any) -> None:
        threading.Thread(target=engine.abort, args=("the abort button",)).start()
        over.wait(60.0)

    if state is State.PREPARING:
        tension.operator.on_perform = never
    else:
        tension.cameras["on_axis"].on_grab = never
    engine = tension.engine()
    outcome = engine.run()
    over.set()
    assert (outcome.status, outcome.unsafe) == ("aborted", ())
    assert tension.states[-3:] == [state.name, "SAFING", "ABORTED"]
    # A person may take all the time; that is no driver which hangs.
    assert len(outcome.lost_devices) == (state is State.IMAGING)


def test_progress_is_reported_after_each_complete_reading_and_says_whether_anything_may_move(tension):
    beats, engine = [], None

    def beat(may_move: bool) -> None:
        beats.append((tension.load_frame.reads, engine.status.state, may_move))

    engine = tension.engine(on_progress=beat)
    assert engine.run().status == "completed"
    readings = [reads for reads, _, _ in beats]
    assert len(set(readings)) == len(readings)
    # A command of a load also reads: it needs the load at which it begins.
    assert len(readings) >= 0.9 * tension.load_frame.reads
    # At first something may move that another program has left in motion; never while images are taken.
    assert beats[0][2]
    assert {moves for _, state, moves in beats if state is State.MOVING} == {True, False}
    assert {moves for _, state, moves in beats if state is State.IMAGING} == {False}


@pytest.mark.parametrize("hangs", ["camera", "frame"])
def test_progress_is_not_reported_without_a_good_reading(tension, hangs):
    beats, engine = [], None
    tension.load_frame.on_read = lambda count, state: state
    hung_s = hang_in(tension, tension.load_frame, "read", 50)
    engine = tension.engine(on_progress=lambda may_move: beats.append(tension.clock.now_s()))
    engine.run()
    assert beats[-1] <= hung_s[0]


def test_progress_that_cannot_be_reported_ends_the_run(tension):
    """Its receiver is what stops the machine when this program dies."""

    def broken(may_move: bool) -> None:
        raise BrokenPipeError("nobody reads")

    with pytest.raises(BrokenPipeError):
        tension.engine(on_progress=broken).run()
    assert tension.calls[-1] == "hold"


@pytest.mark.parametrize("fault", [False, True])
def test_devices_are_watched_while_a_step_is_not_on_the_disk(rotation_table, tmp_path, fault):
    """The disk takes its time until the stage has been read five times, in real time."""
    rotation_table["rotation"]["total_deg"] = rotation_table["rotation"]["increment_deg"]
    rotation_table["settle"] |= {"dwell_s": 0.001, "poll_s": 0.001}
    rig = in_real_time(rotation_table, tmp_path / "run.h5")
    engine = rig.engine()
    step, waiting, reads = engine.context.recorder.step, [], 0

    def slowly(record: StepRecord) -> Future[None]:
        step(record).result()
        waiting.append(Future())
        return waiting[-1]

    def read(state: StageState) -> StageState:
        nonlocal reads
        if waiting and not waiting[-1].done():
            reads += 1
            if fault and reads == 3:
                raise DeviceFault("stage", "read", "no fault", "a stall", "look at it")
            if reads % 5 == 0:
                waiting[-1].set_result(None)
        return state

    engine.context.recorder.step = slowly
    rig.stage.on_read = read
    outcome = engine.run()
    if fault:
        assert "got a stall" in outcome.reason
        # read once more after the end, to say where the stage stands
        assert (reads, outcome.steps_done) == (3 + 1, 0)
    else:
        assert (outcome.status, outcome.steps_done, reads) == ("completed", 3, 15)


def test_devices_are_watched_while_too_many_images_wait_for_the_disk(rotation_table, tmp_path):
    """There is no room for the second image until the stage has been read five times, in real time."""
    rotation_table["settle"] |= {"dwell_s": 0.001, "poll_s": 0.001}
    rotation_table["images"]["per_step"] = 2
    rig = in_real_time(rotation_table, tmp_path / "run.h5")
    engine = rig.engine()
    asked, reads, room = [], [], threading.Event()

    def wait_for_room(camera: str, timeout_s: float) -> bool:
        asked.append(camera)
        return len(asked) != 2 and room.wait(timeout_s) if len(asked) > 1 else True

    def read(state: StageState) -> StageState:
        if len(asked) > 1:
            reads.append(state)
        if len(reads) == 5:
            room.set()
        return state

    engine.context.recorder.wait_for_room = wait_for_room
    rig.stage.on_read = read
    assert engine.run().status == "completed"
    assert asked[:3] == ["on_axis", "off_axis", "off_axis"]
    assert len(reads) > 5


def engine_devices(rig: FakeRig) -> tuple[Devices, Calls]:
    calls = Calls(rig.clock, lambda: None)
    made = Rig(rig.clock, rig.operator, rig.cameras, load_frame=rig.load_frame)
    return called(made, calls), calls


def test_a_change_of_speed_that_hangs_ends_at_the_deadline_of_a_call(tension):
    tension.load_frame.change_speed = lambda speed_mm_s: None
    hung_s = hang_in(tension, tension.load_frame, "change_speed", 2)
    devices, calls = engine_devices(tension)
    assert devices.can_change_speed
    with tension.clock.activity(), closing(calls):
        devices.change_speed(0.02)
        with pytest.raises(DeviceTimeout, match=r"change the speed to 0\.03 mm/s: .* within 0\.7 s"):
            devices.change_speed(0.03)
        assert tension.clock.now_s() - hung_s[0] == pytest.approx(CALL_TIMEOUT_S)


def test_a_frame_that_cannot_change_its_speed_is_not_asked_to(tension):
    devices, calls = engine_devices(tension)
    assert not devices.can_change_speed
    with closing(calls), pytest.raises(DeviceFault, match="one that cannot"):
        devices.change_speed(0.02)
