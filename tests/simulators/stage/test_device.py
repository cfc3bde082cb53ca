import pytest

from drivers.clock import VirtualClock
from simulators.stage.device import StageDevice, StageRefusedError

SPEED, ACCELERATION = 20.0, 200.0


@pytest.fixture
def stage(clock: VirtualClock) -> StageDevice:
    return StageDevice(
        clock,
        power_up_angle_deg=30.0,
        speed_deg_s=SPEED,
        acceleration_deg_s2=ACCELERATION,
        microsteps_per_deg=6400,
    )


def duration(stage: StageDevice, clock: VirtualClock) -> float:
    start_s = clock.now_s()
    while stage.moving:
        clock.sleep(1e-3)
    return clock.now_s() - start_s


def test_a_long_way_takes_distance_over_speed_plus_one_ramp(stage, clock):
    stage.move_to(90 * 6400)
    assert duration(stage, clock) == pytest.approx(90 / SPEED + SPEED / ACCELERATION, abs=2e-3)
    assert stage.angle_deg() == pytest.approx(120.0)


def test_a_short_way_never_reaches_full_speed(stage, clock):
    stage.move_to(3200)
    assert duration(stage, clock) == pytest.approx(2 * (0.5 / ACCELERATION) ** 0.5, abs=2e-3)


def test_halfway_in_time_is_halfway_in_angle(stage, clock):
    stage.move_to(90 * 6400)
    clock.sleep((90 / SPEED + SPEED / ACCELERATION) / 2)
    assert stage.angle_deg() == pytest.approx(30.0 + 45.0)


def test_hours_may_pass_in_one_step(stage, clock):
    stage.move_to(90 * 6400)
    clock.sleep(7200.0)
    assert stage.position == 90 * 6400


def test_stop_brakes_on_the_way_that_the_deceleration_needs(stage, clock):
    stage.move_to(90 * 6400)
    clock.sleep(1.0)
    at_stop = stage.angle_deg()
    stage.stop()
    assert stage.moving
    assert duration(stage, clock) == pytest.approx(SPEED / ACCELERATION, abs=2e-3)
    assert stage.angle_deg() - at_stop == pytest.approx(SPEED**2 / (2 * ACCELERATION))
    assert "NI" in stage.flags


def test_power_up_has_no_reference_and_homing_finds_the_index(stage, clock):
    assert (stage.position, stage.flags) == (0, ["WR"])
    stage.home()
    duration(stage, clock)
    assert stage.angle_deg() == pytest.approx(0.0, abs=1e-9)
    assert (stage.position, stage.flags) == (0, [])


def test_homing_that_is_interrupted_finds_nothing(stage, clock):
    stage.home()
    clock.sleep(0.5)
    stage.stop()
    duration(stage, clock)
    assert stage.flags == ["WR", "NI"]


def test_a_jammed_shaft_finds_no_reference(stage, clock):
    stage.jam()
    stage.home()
    clock.sleep(60.0)
    assert stage.flags == ["FS", "WR"]


def test_a_new_motion_preempts_the_old_one(stage, clock):
    stage.move_to(90 * 6400)
    clock.sleep(1.0)
    stage.move_to(0)
    duration(stage, clock)
    assert stage.position == 0
    assert "NI" in stage.flags


def test_targets_beyond_the_limits_are_refused(stage):
    stage.limit_max = 640_000
    stage.move_to(640_000)
    with pytest.raises(StageRefusedError, match="BADDATA"):
        stage.move_to(640_001)


def test_an_emergency_stop_is_dead_at_once_and_disables(stage, clock):
    stage.move_to(90 * 6400)
    clock.sleep(1.0)
    stage.fail("FH")
    angle_deg = stage.angle_deg()
    clock.sleep(1.0)
    assert stage.angle_deg() == angle_deg
    stage.clear_flags()
    with pytest.raises(StageRefusedError, match="DRIVERDISABLED"):
        stage.move_to(0)
    stage.enable_driver()
    stage.move_to(0)


def test_the_gravest_flag_comes_first(stage):
    stage.fail("NC")
    stage.fail("FS")
    assert stage.flags == ["FS", "WR", "NC"]
