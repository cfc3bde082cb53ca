import threading
from dataclasses import replace
from itertools import pairwise

import h5py
import pytest

from drivers.errors import DeviceError, DeviceTimeout
from drivers.interfaces import OperatorAction
from rig.engine.status import State
from rig.recorder import Recorder


def read_run(path) -> dict:
    with h5py.File(path) as file:
        entry = file["entry"]
        return {
            "status": entry["status"][()].decode(),
            "reason": entry["status_reason"][()].decode(),
            "kinds": [kind.decode() for kind in entry["steps/kind"][()]],
            "index": list(entry["steps/index"][()]),
            "target": list(entry["steps/target"][()]),
            "displacement_mm": list(entry["steps/displacement_mm"][()]),
            "load_n": list(entry["steps/load_n"][()]),
            "angle_deg": list(entry["steps/angle_deg"][()]),
            "events": [message.decode() for message in entry["events/message"][()]],
        }


def mute_camera(count, frame):
    raise DeviceTimeout("cameras.off_axis", "grab", "an image", "none", "check the cable")


def test_tension_loads_until_plastic_then_stretches_to_exactly_the_total(tension):
    outcome = tension.engine().run()

    run = read_run(tension.path)
    assert (outcome.status, outcome.reason) == ("completed", "")
    assert run["kinds"][:7] == ["grid", "reference", "load", "load", "load", "load", "load"]
    assert set(run["kinds"][7:]) == {"displacement"}
    # The fake specimen yields at 8.5 kN and 0.55 mm and hardens by 1 kN/mm.
    start_mm = 0.55 + 1.5
    assert run["displacement_mm"][6] == pytest.approx(start_mm, abs=0.02)
    assert run["target"][-1] == 5.0
    steps_mm = [b - a for a, b in pairwise(run["target"][7:])]
    assert steps_mm[:-1] == pytest.approx([0.3] * (len(steps_mm) - 1))
    assert steps_mm[-1] == pytest.approx(0.25, abs=0.02)
    assert run["displacement_mm"][-1] == pytest.approx(5.0, abs=0.002)
    assert tension.calls[-1] == "hold"


def test_steps_keep_the_numbers_of_the_plan_when_load_increments_are_left_out(tension_table, tension):
    table = tension_table | {"loading": tension_table["loading"] | {"increments_max": 6}}
    tension.protocol = type(tension.protocol).model_validate(table)
    tension.engine().run()
    planned = {step.index: step.kind for step in tension.protocol.steps()}

    run = read_run(tension.path)
    assert [planned[index] for index in run["index"]] == run["kinds"]
    assert 7 not in run["index"]


def test_tension_passes_through_its_states_in_order(tension):
    engine = tension.engine()
    assert engine.status.state is State.IDLE
    engine.run()

    step = ["MOVING", "IMAGING"]
    steps = engine.status.steps_done
    assert tension.states == ["PREPARING", *step, "PREPARING", *step, *step * (steps - 2), "COMPLETED"]


def test_grid_is_attached_before_the_first_image_and_removed_before_the_reference(tension):
    images_at = {}
    tension.operator.on_perform = lambda action: images_at.update({action: tension.cameras["on_axis"].grabs})
    tension.engine().run()

    assert images_at == {OperatorAction.ATTACH_GRID: 0, OperatorAction.REMOVE_GRID: 1}
    assert tension.calls[:5] == ["hold", "ATTACH_GRID", "hold", "REMOVE_GRID", "tare"]


def test_rotation_homes_returns_to_zero_and_turns_once_around(rotation):
    outcome = rotation.engine().run()

    run = read_run(rotation.path)
    assert outcome.status == "completed"
    assert rotation.calls[:3] == ["home", "angle 0", "ATTACH_GRID"]
    assert run["angle_deg"] == pytest.approx([0.0, *(22.5 * i for i in range(17))])
    assert "stop" not in rotation.calls


def test_stage_that_is_homed_is_not_homed_again(rotation):
    rotation.stage.homed = True
    rotation.engine().run()
    assert "home" not in rotation.calls


def test_load_frame_is_read_between_images_of_a_step(tension):
    reads = []
    for camera in tension.cameras.values():
        camera.on_grab = lambda count, frame: reads.append(tension.load_frame.reads) or frame
    tension.engine().run()
    assert all(later > earlier for earlier, later in pairwise(reads))


def test_camera_failure_holds_the_frame_first_and_closes_the_file_as_failed(tension):
    tension.cameras["off_axis"].on_grab = lambda count, frame: (
        mute_camera(count, frame) if count == 3 else frame
    )
    status_at_hold = []

    def look():
        with h5py.File(tension.path, "r", swmr=True) as file:
            status_at_hold.append(file["entry/status"][()])

    tension.load_frame.on_hold = look
    engine = tension.engine()
    outcome = engine.run()

    run = read_run(tension.path)
    assert tension.calls[-1] == "hold"
    assert status_at_hold[-1] == b"running"
    assert (outcome.status, run["status"]) == ("failed", "failed")
    assert run["reason"] == outcome.reason
    assert "cameras.off_axis: grab: expected an image" in run["reason"]
    assert run["kinds"] == ["grid", "reference"]
    assert run["events"][-1].startswith("cameras.off_axis")
    assert engine.status.state is State.FAILED
    assert tension.states[-3:] == ["IMAGING", "SAFING", "FAILED"]


@pytest.fixture
def explode_at(monkeypatch):
    """A function that lets the recording of a step raise an exception that no code expects."""

    def at(index, before=lambda: None):
        record = Recorder.step

        def explode(recorder, made):
            if made.step.index == index:
                before()
                raise ZeroDivisionError("a bug")
            return record(recorder, made)

        monkeypatch.setattr(Recorder, "step", explode)

    return at


def test_unknown_exception_makes_safe_closes_the_file_and_is_raised_again(rotation, explode_at):
    explode_at(2)
    with pytest.raises(ZeroDivisionError):
        rotation.engine().run()
    assert rotation.calls[-1] == "stop"
    assert rotation.states[-2:] == ["SAFING", "FAILED"]
    assert read_run(rotation.path)["status"] == "failed"


def test_unknown_exception_of_a_driver_fails_the_run(rotation):
    def explode(state):
        if state.angle_deg == 45.0:
            raise ZeroDivisionError("a driver with a bug")
        return state

    rotation.stage.on_read = explode
    assert "stage: read: expected a call" in rotation.engine().run().reason


def test_abort_from_another_thread_takes_effect_within_one_poll(tension):
    readings_after = 0

    def abort_in_step_3(count, state):
        nonlocal readings_after
        status = engine.status
        if status.step and status.step.index == 3 and status.state is State.MOVING:
            if readings_after == 0:
                thread = threading.Thread(target=engine.abort, args=("the abort button",))
                thread.start()
                thread.join()
            readings_after += 1
        return state

    tension.load_frame.on_read = abort_in_step_3
    engine = tension.engine()
    outcome = engine.run()
    assert outcome.status == "aborted"
    assert "the abort button" in outcome.reason
    assert tension.states[-3:] == ["MOVING", "SAFING", "ABORTED"]
    assert readings_after == 1
    # Once by the thread that asked for it, once by the engine.
    assert tension.calls[-2:] == ["hold", "hold"]


def test_abort_is_an_abort_even_if_a_driver_complains_of_the_stop_first(rotation):
    engine = None

    def interrupted(state):
        if state.angle_deg == 45.0:
            engine.abort("SIGTERM")
            raise DeviceError("stage", "move", "no stop meanwhile", "a stop", "move again")
        return state

    rotation.stage.on_read = interrupted
    engine = rotation.engine()
    outcome = engine.run()
    assert outcome.status == "aborted"
    assert "got SIGTERM" in outcome.reason
    assert "meanwhile: stage: move: expected no stop meanwhile" in outcome.reason


def test_abort_before_the_run_moves_nothing(tension):
    engine = tension.engine()
    engine.abort("changed my mind")
    assert engine.run().status == "aborted"
    assert set(tension.calls) == {"hold"}


def test_safe_state_that_fails_is_said_loudly_and_the_other_device_is_still_stopped(rotation, tension):
    def refuse():
        raise DeviceTimeout("load_frame", "hold", "standstill", "silence", "check the link")

    tension.load_frame.on_hold = refuse
    tension.stage = rotation.stage
    tension.cameras["on_axis"].on_grab = mute_camera
    outcome = tension.engine().run()

    assert rotation.calls[-1] == "stop"
    assert len(outcome.unsafe) == 1
    assert "silence" in outcome.unsafe[0]
    assert outcome.reason.startswith("SAFE STATE NOT CONFIRMED, use the emergency stop")
    assert read_run(tension.path)["reason"].startswith("SAFE STATE NOT CONFIRMED")


def test_value_that_never_settles_ends_at_the_deadline(tension):
    tension.load_frame.stuck = True
    outcome = tension.engine().run()

    assert outcome.status == "failed"
    assert outcome.reason.startswith("step 2 (load 2000 N), settling: expected 2000 ± 20 for 1 s within 60 s")
    command_s = 2.0  # grid and reference dwell some seconds
    assert command_s < tension.clock.now_s() < 75.0
    assert tension.calls[-1] == "hold"


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"load_n": 13000.5}, "expected a load within 13000 N, got 13000.5 N"),
        ({"load_n": -13000.5}, "expected a load of at least -100 N, got -13000.5 N"),
        ({"displacement_mm": 5.3}, "expected a displacement within 5.2 mm, got 5.3 mm"),
        ({"faults": ("overtravel", "watchdog")}, "expected no fault, got overtravel, watchdog"),
    ],
)
def test_limit_or_fault_at_any_reading_ends_the_run(tension, on_frame_state, changes, said):
    tension.load_frame.on_read = on_frame_state(60, **changes)
    outcome = tension.engine().run()

    assert outcome.status == "failed"
    assert said in outcome.reason
    assert tension.load_frame.reads == 60 + 1  # and once more, to say what holds
    assert tension.calls[-1] == "hold"


def test_broken_specimen_ends_the_run_and_keeps_its_steps(tension):
    def tear(count, frame):
        if engine.status.step.kind == "displacement":
            tension.load_frame.load_scale = 0.1
        return frame

    tension.cameras["off_axis"].on_grab = tear
    engine = tension.engine()
    outcome = engine.run()
    assert outcome.status == "failed"
    assert "the specimen broke" in outcome.reason
    assert tension.calls[-1] == "hold"
    assert read_run(tension.path)["kinds"][-1] == "load"


def test_soft_grips_at_small_loads_are_no_break(tension, on_frame_state):
    loads = iter([0.0, 0.0, 0.0, 0.0, 900.0, 100.0])
    tension.load_frame.on_read = lambda count, state: replace(state, load_n=next(loads, 100.0))
    outcome = tension.engine().run()
    assert "broke" not in outcome.reason


def test_loaded_specimen_is_not_zeroed(tension):
    tension.load_frame.zero_n = 150.0
    outcome = tension.engine().run()
    assert "expected a load within 100 N, got 150.0 N" in outcome.reason
    assert "tare" not in tension.calls


def test_small_zero_offset_is_removed_and_kept_in_the_events(tension):
    tension.load_frame.zero_n = 40.0
    assert tension.engine().run().status == "completed"
    assert "load frame: zero at 40.0 N, 0.0000 mm" in read_run(tension.path)["events"]


def test_specimen_that_shows_no_plasticity_ends_the_run(tension):
    table = tension.protocol.model_dump()
    table["loading"]["plastic"]["stiffness_fraction"] = 0.001
    tension.protocol = type(tension.protocol).model_validate(table)
    outcome = tension.engine().run()
    assert "expected an increment of less than 0.001 of the highest stiffness, got none" in outcome.reason


def test_operator_who_refuses_ends_the_run(tension):
    def refuse(action):
        raise DeviceError("operator", action.value, "yes", "no", "start again")

    tension.operator.on_perform = refuse
    outcome = tension.engine().run()
    assert (outcome.status, outcome.steps_done) == ("failed", 0)


def test_protocol_on_a_rig_without_its_device_is_refused(tension):
    tension.load_frame = None
    outcome = tension.engine().run()
    assert "expected a [load_frame] in the rig file" in outcome.reason


def test_operator_is_asked_only_once_everything_stands_still(tension):
    tension.load_frame.go_to_displacement(0.4, 0.02)
    tension.load_frame.hold = lambda: tension.calls.append("hold")  # a machine that takes its time to stop
    moving_when_asked = []
    tension.operator.on_perform = lambda action: moving_when_asked.append(tension.load_frame._advance())
    tension.engine().run()
    assert moving_when_asked[0] is False


def test_motion_that_no_hold_ends_keeps_the_operator_away(tension):
    tension.load_frame.on_read = lambda count, state: replace(state, moving=True, at_target=False)
    outcome = tension.engine().run()
    assert "standing still for the operator: expected standstill" in outcome.reason
    assert "ATTACH_GRID" not in tension.calls


def test_load_that_is_no_number_ends_the_run_at_once(tension, on_frame_state):
    tension.load_frame.on_read = on_frame_state(60, load_n=float("nan"))
    outcome = tension.engine().run()
    assert "expected a load of at least -100 N, got nan N" in outcome.reason
    assert tension.load_frame.reads == 60 + 1  # and once more, to say what holds


def test_unknown_exception_carries_the_warning_that_the_machine_is_not_safe(tension, explode_at):
    def refuse():
        raise DeviceTimeout("load_frame", "hold", "a hold", "silence", "check the link")

    explode_at(2, lambda: setattr(tension.load_frame, "on_hold", refuse))
    with pytest.raises(ZeroDivisionError) as caught:
        tension.engine().run()
    assert caught.value.__notes__[0].startswith("SAFE STATE NOT CONFIRMED, use the emergency stop")


def test_abort_just_before_the_operator_is_asked_leaves_nobody_waiting(tension, monkeypatch):
    engine = tension.engine()

    def abort_at_the_question(recorder, time_s, level, source, message):
        if message.startswith("operator"):
            engine.abort("SIGTERM")

    monkeypatch.setattr(Recorder, "event", abort_at_the_question)
    assert engine.run().status == "aborted"
    assert "ATTACH_GRID" not in tension.calls


def test_abort_while_a_device_is_read_takes_no_further_image(tension):
    engine = tension.engine()

    def abort_after_the_first_image(count, state):
        if tension.cameras["on_axis"].grabs == 1:
            engine.abort("SIGTERM")
        return state

    tension.load_frame.on_read = abort_after_the_first_image
    assert engine.run().status == "aborted"
    assert tension.cameras["off_axis"].grabs == 0


def test_load_frame_that_takes_no_zero_ends_the_run(tension):
    tension.load_frame.zero_n = 40.0
    tension.load_frame.tare = lambda: None
    outcome = tension.engine().run()
    assert "zeroing the load frame: expected load and displacement of zero" in outcome.reason


def test_machine_that_regulates_at_its_target_and_calls_that_moving_settles(tension):
    tension.load_frame.on_read = lambda count, state: replace(state, moving=True)
    assert tension.engine().run().status == "completed"


def test_stage_that_is_at_its_target_but_still_moves_has_not_settled(rotation):
    stage = rotation.stage
    stage.on_read = lambda state: replace(state, angle_deg=stage._target[1])
    arrived = []
    rotation.cameras["on_axis"].on_grab = lambda count, frame: (
        arrived.append(stage._target[0] <= frame.exposed_s) or frame
    )
    assert rotation.engine().run().status == "completed"
    assert all(arrived)
