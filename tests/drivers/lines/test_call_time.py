"""All requests of a call of a driver keep one deadline, which ends before that of the rig."""

import math
from concurrent.futures import ThreadPoolExecutor

import pytest

from drivers.clock import VirtualClock
from drivers.errors import DeviceTimeout
from drivers.lines.call_time import MARGIN_S, OPENING_S, CallTime, one_call

RIG_S = 60.0


def test_outside_a_call_every_attempt_has_the_same_time():
    time = CallTime(RIG_S)
    assert (time.left_s, time.first_wait_s(0.25), time.last_wait_s(0.25)) == (math.inf, 0.25, 0.25)


def test_without_a_rig_a_call_has_no_end():
    time = CallTime()
    with time.call():
        assert (time.left_s, time.last_wait_s(0.25)) == (math.inf, 0.25)


def test_the_last_attempt_waits_until_the_call_ends_before_the_rigs_deadline():
    time = CallTime(RIG_S)
    with time.call():
        assert time.first_wait_s(0.25) == 0.25
        assert 0.25 < time.last_wait_s(0.25) <= RIG_S - MARGIN_S
        # no attempt, however long its reply timeout, waits beyond the call
        assert time.first_wait_s(1e6) <= RIG_S - MARGIN_S
    assert time.left_s == math.inf


def test_a_short_deadline_keeps_most_of_its_time():
    time = CallTime(0.05)
    with time.call():
        assert time.last_wait_s(1.0) <= 0.8 * 0.05


def test_a_caller_may_give_a_call_less_time():
    time = CallTime(RIG_S, patience_s=2.0)
    with time.call(within_s=0.5):
        assert 2.0 < time.left_s <= 2.5
    with time.call(within_s=1e6):
        assert time.left_s <= RIG_S - MARGIN_S + 2.0
    assert time.left_s == math.inf


def test_a_call_within_a_call_keeps_the_outer_end():
    time = CallTime(RIG_S)
    with time.call():
        before_s = time.left_s
        with time.call():
            assert time.left_s <= before_s
        assert time.left_s < math.inf


def test_each_thread_has_a_call_of_its_own():
    """A stop, from another thread, is not bound to the end of a reading."""
    time = CallTime(RIG_S)
    with time.call(), ThreadPoolExecutor(1) as pool:
        assert pool.submit(lambda: time.left_s).result() == math.inf


def test_a_method_is_one_call_even_if_it_fails():
    class Device:
        _call_time = CallTime(RIG_S)

        @one_call
        def read(self, fail: bool) -> float:
            if fail:
                raise ValueError
            return self._call_time.left_s

    assert 0 < Device().read(False) < RIG_S
    with pytest.raises(ValueError):  # noqa: PT011
        Device().read(True)
    assert Device._call_time.left_s == math.inf


def timeout() -> DeviceTimeout:
    return DeviceTimeout(
        "stage (/dev/ttyS0)", "send 'get pos'", "an answer within 0.25 s", "silence", "check it"
    )


def test_opening_is_limited_and_its_error_says_so():
    """Each answer of the device comes late, so that every request succeeds, but only just."""
    clock = VirtualClock()
    time = CallTime(clock=clock)

    def open_slowly() -> None:
        with time.opening(0.25):
            while time.left_s > 0:
                clock.sleep(0.35)
            raise timeout()

    with pytest.raises(DeviceTimeout) as error:
        open_slowly()
    assert OPENING_S <= clock.now_s() < 5.0
    assert str(error.value) == (
        "stage (/dev/ttyS0): open: expected all answers within 4 s, got late answers, and at last silence "
        "(send 'get pos'); check the line; for a slow device raise reply_timeout_s above 0.25"
    )
    assert time.left_s == math.inf


def test_a_missing_answer_on_opening_is_reported_after_the_reply_timeout():
    time = CallTime(RIG_S, VirtualClock())
    silence = timeout()

    def open_in_vain() -> None:
        with time.opening(0.25):
            assert not time.patient
            assert (time.first_wait_s(0.25), time.last_wait_s(0.25)) == (0.25, 0.25)
            with time.call():
                # a call of the driver's own on opening is part of it
                assert time.last_wait_s(0.25) == 0.25
            raise silence

    with pytest.raises(DeviceTimeout) as error:
        open_in_vain()
    assert error.value is silence
    with time.call():
        assert time.patient


def test_patience_lengthens_calls_and_each_answer_on_opening():
    time = CallTime(0.7, VirtualClock(), patience_s=10.0)
    assert time.first_wait_s(0.25) == 0.25
    with time.call():
        assert (time.first_wait_s(0.25), time.last_wait_s(0.25)) == (0.25, 10.62)
    with time.opening(0.25):
        assert (time.first_wait_s(0.25), time.last_wait_s(0.25)) == (10.25, 10.25)
        assert time.left_s == OPENING_S + 10.0


def test_a_slow_device_has_more_time_for_opening():
    time = CallTime(clock=VirtualClock())
    with time.opening(10.0):
        assert time.left_s == 40.0
