"""Each motion by hand on simulated devices ends with a hold, and stays within its permitted range."""

import threading
from dataclasses import replace

import pytest

from drivers.errors import DeviceError
from rig.commands.hand_plan import Wish, plan
from rig.devices import Rig
from rig.engine.manual import Manual
from rig.errors import RigError
from rig.facts import RigFacts
from rig.limit_settings import RigLimits

LOADED_MM = 0.4
"""Displacement in mm at which the simulated specimen carries 5833 N."""


def rig_of(fakes) -> Rig:
    return Rig(fakes.clock, fakes.operator, {}, fakes.stage, fakes.load_frame, virtual=True)


def agree(motion, reading) -> None:
    pass


def moved(fakes, wish, confirm=agree, **options):
    rig = rig_of(fakes)
    facts = RigFacts(angle_min_deg=-5.0, angle_max_deg=365.0, speed_deg_s=10.0)
    return Manual(rig, **options).move(lambda reading: plan(wish, reading, rig, facts), confirm)


def test_unloads_slowly_to_zero_and_holds(tension):
    tension.load_frame.displacement_mm = LOADED_MM
    done = moved(tension, Wish("load", 0.0))
    assert (done.status, done.reason, done.unsafe) == ("completed", "", ())
    assert done.at_end.load_frame.load_n == pytest.approx(0.0, abs=30.0)
    assert done.at_end.load_frame.holding
    assert tension.calls == ["load 0", "hold"]
    # full load, 15 kN, takes 100 s, so 5.8 kN take 39 s
    assert 35.0 < tension.clock.now_s() < 45.0


@pytest.mark.parametrize(
    ("wish", "call"),
    [
        (Wish("load", 1000.0), "load 1000"),
        (Wish("displacement", 0.5), "displacement 0.500000"),
        (Wish("displacement", 0.1, relative=True), "displacement 0.500000"),
        (Wish("displacement", -0.1, relative=True, rate=0.05), "displacement 0.300000"),
    ],
)
def test_a_jog_goes_to_its_target_and_holds(tension, wish, call):
    tension.load_frame.displacement_mm = LOADED_MM
    assert moved(tension, wish).status == "completed"
    assert tension.calls == [call, "hold"]


def test_a_jog_turns_the_stage(rotation):
    rotation.stage.homed = True
    done = moved(rotation, Wish("angle", 13.0, relative=True))
    assert (done.status, done.at_end.stage.angle_deg) == ("completed", 90.0)
    assert rotation.calls == ["angle 90", "stop"]


@pytest.mark.parametrize(
    ("wish", "said"),
    [
        (Wish("load", 15001.0), "expected a load from -100 to 15000 N, the limits of the rig, got 15001 N"),
        (Wish("load", 10000.0, relative=True), "got 15833"),
        (Wish("load", float("nan")), "got nan N"),
        (Wish("displacement", 6.5), "expected a displacement from -1 to 6 mm"),
        (Wish("load", 0.0, rate=1001.0), "expected a rate above 0 up to 1000 N/s, got 1001 N/s"),
        (Wish("load", 0.0, rate=0.0), "give --rate 150, or leave it out"),
        (Wish("displacement", 1.0, rate=float("nan")), "got nan mm/s"),
    ],
)
def test_nothing_moves_beyond_the_limits_of_the_rig(tension, wish, said):
    tension.load_frame.displacement_mm = LOADED_MM
    done = moved(tension, wish)
    assert done.status == "failed"
    assert said in done.reason
    assert tension.calls == ["hold"]


def test_nothing_turns_beyond_the_limits_of_the_stage(rotation):
    done = moved(rotation, Wish("angle", 366.0))
    assert "expected a angle from -5 to 365 deg" in done.reason.replace("an angle", "a angle")
    assert rotation.calls == ["stop"]


def test_a_motion_that_is_not_confirmed_is_not_begun(tension):
    def refuse(motion, reading):
        raise RigError(motion.doing, "the word", "no answer", "answer")

    done = moved(tension, Wish("load", 1000.0), refuse)
    assert (done.status, done.at_end.load_frame.holding) == ("failed", True)
    assert tension.calls == ["hold"]


def test_the_machine_is_watched_while_a_person_is_asked(tension):
    done = moved(tension, Wish("load", 1000.0), lambda motion, reading: tension.clock.sleep(5.0))
    assert done.status == "completed"
    tension.load_frame.on_read = lambda count, state: (_ for _ in ()).throw(
        DeviceError("load_frame", "read", "an answer", "none", "check the cable")
    )
    done = moved(tension, Wish("load", 2000.0), lambda motion, reading: tension.clock.sleep(5.0))
    assert "check the cable" in done.reason
    assert tension.calls.count("load 2000") == 0


def test_a_travel_beyond_the_permitted_one_ends_the_motion(tension):
    done = moved(tension, Wish("load", 8000.0, travel_max_mm=0.2))
    assert done.status == "failed"
    assert "expected a displacement from -0.2 to 0.2 mm" in done.reason
    assert 0.2 < tension.load_frame.displacement_mm < 0.25
    assert tension.calls[-1] == "hold"


def test_an_unload_that_pulls_ends_the_motion(tension):
    tension.load_frame.displacement_mm = LOADED_MM
    tension.load_frame.go_to_load = lambda load_n, rate_n_s: tension.load_frame.go_to_displacement(6.0, 0.02)
    done = moved(tension, Wish("load", 0.0))
    assert "expected a load that falls during this motion, below 6" in done.reason
    # 5 % of the motion, 292 N, are 0.016 mm; a reading takes 0.002 mm
    assert tension.load_frame.displacement_mm < LOADED_MM + 0.016 + 3 * 0.002
    assert tension.calls[-1] == "hold"


def test_the_travel_of_an_unload_is_bounded_by_the_softest_plausible_specimen(tension):
    tension.load_frame.displacement_mm = LOADED_MM
    reading = Manual(rig_of(tension)).read()
    limits = RigLimits(machine_stiffness_min_n_mm=10_000.0, specimen_stiffness_min_n_mm=10_000.0)
    motion = plan(Wish("load", 0.0), reading, replace(rig_of(tension), limits=limits), RigFacts())
    # 5833 N at 5 kN/mm, and a backlash of 0.02 mm
    assert motion.displacement_mm == pytest.approx((LOADED_MM - 0.02 - 5833.333 / 5000.0, LOADED_MM + 0.02))


LIES = {
    "zero": lambda load_n, stuck_n: 0.0,
    "tenth": lambda load_n, stuck_n: 0.1 * load_n,
    "reversed": lambda load_n, stuck_n: -load_n,
    "stuck": lambda load_n, stuck_n: stuck_n,
}


def lie(fakes, name: str, first: int, clean_n: float = 0.0) -> None:
    """Make the load cell wrong from its reading number `first` on, with an alternating error of `clean_n`."""
    stuck: list[float] = []

    def on_read(count, state):
        load_n = state.load_n
        if count >= first:
            stuck.append(load_n)
            load_n = LIES[name](load_n, stuck[0])
        return replace(state, load_n=load_n + (-1.0) ** count * clean_n)

    fakes.load_frame.on_read = on_read


@pytest.mark.parametrize("lied", LIES)
@pytest.mark.parametrize("noise_n", [0.0, 1.0])
@pytest.mark.parametrize(
    ("wish", "start_mm", "target_mm"),
    [
        (Wish("load", 0.0), LOADED_MM, 0.0),
        (Wish("load", 8000.0), 0.0, 0.52),
        (Wish("load", 8000.0), 0.2, 0.52),
        (Wish("displacement", 0.5), 0.0, 0.5),
        (Wish("displacement", 0.1), LOADED_MM, 0.1),
    ],
)
def test_a_load_cell_that_begins_to_lie_ends_every_motion(tension, wish, start_mm, target_mm, noise_n, lied):
    tension.load_frame.displacement_mm = start_mm
    # A motion to a load takes 700 readings or more, a motion to a displacement 85 or more.
    lie(tension, lied, 300 if wish.axis == "load" else 70, noise_n)
    done = moved(tension, wish)
    assert done.status == "failed"
    assert "load cell" in done.reason
    assert tension.calls[-1] == "hold"
    travelled = abs(tension.load_frame.displacement_mm - start_mm)
    assert travelled < abs(target_mm - start_mm)


@pytest.mark.parametrize("lied", ["zero", "reversed", "stuck"])
@pytest.mark.parametrize("wish", [Wish("load", 8000.0), Wish("displacement", 0.5)])
def test_a_load_cell_that_lied_before_ends_a_motion_that_loads_the_specimen(tension, wish, lied):
    lie(tension, lied, 1, 1.0)
    done = moved(tension, wish)
    assert done.status == "failed"
    # The slack of 0.1 mm, one window of the load and the margins for noise: before half of the way.
    assert tension.load_frame.displacement_mm < 0.2
    assert tension.calls[-1] == "hold"


def test_declared_stiffnesses_notice_a_tenth_of_the_load_that_was_shown_from_the_beginning(tension):
    lie(tension, "tenth", 1, 1.0)
    limits = RigLimits(
        machine_stiffness_min_n_mm=20_000.0,
        specimen_stiffness_min_n_mm=20_000.0,
        seating_mm=0.1,
        seating_stiffness_n_mm=5_000.0,
    )
    rig = replace(rig_of(tension), limits=limits)
    done = Manual(rig).move(lambda reading: plan(Wish("load", 8000.0), reading, rig, RigFacts()), agree)
    assert done.status == "failed"
    # 800 N would be shown at 0.52 mm, but they explain 0.1 mm of slack, 0.08 mm and 0.1 mm of seating.
    assert tension.load_frame.displacement_mm < 0.1 + 0.08 + 0.1


def test_without_a_specimen_only_a_free_motion_goes_on(tension):
    tension.load_frame.load_scale = 0.0
    assert moved(tension, Wish("displacement", 0.5)).status == "failed"
    tension.load_frame.displacement_mm = 0.0
    assert moved(tension, Wish("displacement", 0.5, free=True)).status == "completed"
    tension.load_frame.load_scale = 1.0
    tension.load_frame.displacement_mm = -0.2
    done = moved(tension, Wish("displacement", 0.5, free=True))
    # one per cent of 15 kN
    assert "expected a load from -150 to 150 N" in done.reason


@pytest.mark.parametrize("when", ["asked", "moving"])
def test_an_abort_holds_at_once(tension, when):
    rig = rig_of(tension)
    manual: list[Manual] = []
    readings = 0

    def interrupt() -> None:
        thread = threading.Thread(target=manual[0].abort, args=("SIGINT",))
        thread.start()
        thread.join()

    def on_reading(reading):
        nonlocal readings
        readings += 1
        if readings == 30 and when == "moving":
            interrupt()

    def confirm(motion, reading):
        if when == "asked":
            interrupt()

    manual.append(Manual(rig, on_reading=on_reading))
    wish = Wish("displacement", 5.0)
    done = manual[0].move(lambda reading: plan(wish, reading, rig, RigFacts()), confirm)
    assert done.status == "aborted"
    assert "got SIGINT" in done.reason
    assert done.at_end.load_frame.holding
    assert tension.calls[-1] == "hold"
    if when == "asked":
        assert set(tension.calls) == {"hold"}
    else:
        assert tension.load_frame.displacement_mm < 1.0


def test_a_hold_that_is_not_confirmed_names_the_emergency_stop(tension):
    def fail():
        raise DeviceError("load_frame", "hold", "a confirmation", "none", "use the emergency stop")

    tension.load_frame.on_hold = fail
    done = Manual(rig_of(tension)).hold()
    assert done.status == "failed"
    assert done.reason.startswith("SAFE STATE NOT CONFIRMED, use the emergency stop")
