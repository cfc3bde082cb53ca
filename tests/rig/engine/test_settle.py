import math
from types import SimpleNamespace

import pytest

from drivers.clock import VirtualClock
from rig.engine.motion import RunMotion
from rig.engine.settle import settle
from rig.errors import SettleTimeout
from rig.protocol.step import ProtocolStep, RigReading


def wait(load_at, *, dwell_s=1.0, timeout_s=10.0):
    clock = VirtualClock()
    return settle(
        lambda: RigReading(clock.now_s(), load_n=load_at(clock.now_s())),
        lambda reading: abs(reading.load_n - 100.0) <= 5.0,
        dwell_s=dwell_s,
        timeout_s=timeout_s,
        poll_s=0.1,
        clock=clock,
        pause=clock.sleep,
        step="step 2",
        expected="100 ± 5",
    )


def test_value_counts_once_it_stayed_for_the_dwell():
    assert wait(lambda t: min(100.0, 50.0 * t)).time_s == pytest.approx(3.0, abs=0.25)


def test_passing_through_the_band_is_not_settling():
    # Inside the band from 0.95 to 1.05 s only, and back in it for good from 5 s.
    assert wait(lambda t: 100.0 * t if t < 5.0 else 100.0).time_s == pytest.approx(6.0, abs=0.25)


def test_leaving_the_band_starts_the_dwell_again():
    assert wait(lambda t: 200.0 if 0.5 < t < 0.7 else 100.0).time_s == pytest.approx(1.7, abs=0.25)


def test_deadline_says_what_was_expected_and_what_was_read():
    with pytest.raises(SettleTimeout, match=r"step 2: expected 100 ± 5 for 1 s within 10 s, got 0 N"):
        wait(lambda t: 0.0)


def test_error_of_a_device_ends_the_wait_at_once():
    def fail(t):
        raise ConnectionError

    with pytest.raises(ConnectionError):
        wait(fail)


def test_a_remainder_of_rounding_lets_time_pass_before_the_images_of_a_hold():
    now_s, pauses = 0.0, []

    def pause(duration_s: float) -> None:
        nonlocal now_s
        pauses.append(duration_s)
        assert len(pauses) < 100, "no time passes"
        now_s += duration_s

    def read() -> RigReading:
        # The device's time is one bit early when the images are due.
        return RigReading(math.nextafter(1.0, 0.0) if 1.0 <= now_s < 1.0005 else now_s, load_n=100.0)

    run = SimpleNamespace(
        read=read,
        calls=SimpleNamespace(pause=pause),
        protocol=SimpleNamespace(images=SimpleNamespace(per_step=1)),
        settle=SimpleNamespace(timeout_s=1.0, poll_s=0.3),
        watch=SimpleNamespace(poll_s=lambda poll_s: poll_s, expect=lambda load_drop: None),
        pauses=SimpleNamespace(point=lambda place: None, ended_s=-1.0),
    )
    motion = RunMotion(run)
    motion._begun_s, motion._kept_s, motion._poll_s = 0.0, 0.0, 0.3
    (reading,) = motion.moments(ProtocolStep(2, "creep", 100.0, 1.0, 10.0, at_s=1.0, begins=False))
    assert reading.time_s == pytest.approx(1.0, abs=0.01)
    assert len(pauses) == 5
