"""Seconds of a device's clock never go back, whatever the device does."""

import pytest

from drivers.channels.device_time import DeviceTime


def test_a_time_that_wraps_goes_on():
    time = DeviceTime(1e-3, wraps_at=1000.0)
    assert [time.seconds(each, 0.0) for each in (980.0, 999.0, 5.0, 990.0, 2.0)] == pytest.approx(
        [0.98, 0.999, 1.005, 1.99, 2.002]
    )
    assert time.restart == ""


def test_after_a_restart_the_seconds_go_on_by_the_clock_of_the_rig():
    time = DeviceTime(1.0)
    assert time.seconds(100.0, 5000.5) == 100.0
    # the message was as long on its way as the one before
    assert time.seconds(3.0, 5010.5) == pytest.approx(110.0)
    assert time.restart == "a clock that went back from 100 to 3 s"
    assert time.seconds(4.0, 5011.6) == pytest.approx(111.0)
    assert time.restart == ""


def test_the_same_time_is_the_same_message():
    time = DeviceTime(1.0)
    assert not time.is_repeated(7.0)
    time.seconds(7.0, 0.0)
    assert time.is_repeated(7.0)
