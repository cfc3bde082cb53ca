"""The driver `nidaqmx-channels` passes the contract tests with an imitation of the library."""

import pytest

from drivers.testing import ChannelsBench, ChannelsContract


class TestNidaqmxChannels(ChannelsContract):
    # a voltage input always has a value, also if its cable is broken
    test_a_value_that_is_none_is_no_number = None  # type: ignore[assignment]
    # the maker's library has no request that could be counted
    test_reading_changes_nothing = None  # type: ignore[assignment]

    @pytest.fixture
    def bench(self, daq, open_device) -> ChannelsBench:
        device = open_device()

        def show(name, value):
            scale, offset, which = {"force": (5000.0, 0.0, "ai0"), "travel": (2.0, 20.0, "ai3")}[name]
            daq.volts[which] = (value - offset) / scale

        def unplug():
            daq.plugged = False

        def stop():
            daq.clocked = False

        def restore():
            daq.plugged = daq.clocked = True

        return ChannelsBench(
            device,
            daq.clock,
            {"force": 12_500.0, "travel": 18.0},
            tolerance=1e-6,
            show=show,
            lose_answers=stop,
            restore=restore,
            unplug=unplug,
            skip_samples=lambda: daq.clock.sleep(11.0),
        )
