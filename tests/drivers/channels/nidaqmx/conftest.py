"""An imitated NI-DAQmx device, and the driver that reads it."""

from contextlib import ExitStack, closing

import pytest

from drivers.channels.nidaqmx.channels import open_channels
from drivers.channels.nidaqmx.settings import NidaqmxSettings
from drivers.interfaces import OpenContext
from tests.drivers.channels.nidaqmx.fake_nidaqmx import FakeDaq

FORCE = {"input": "ai0", "unit": "N", "scale": 5000.0, "range": [-50e3, 50e3], "terminals": "differential"}
TRAVEL = {"input": "ai3", "unit": "mm", "scale": 2.0, "offset": 20.0, "range": [10.0, 30.0], "volts": 5.0}


@pytest.fixture
def daq(clock):
    daq = FakeDaq(clock)
    daq.volts |= {"ai0": 2.5, "ai3": -1.0}
    return daq


@pytest.fixture
def open_device(daq):
    with ExitStack() as opened:

        def open_one(**table):
            settings = {"device": "Dev1", "rate_hz": 1000.0, "signals": {"force": FORCE, "travel": TRAVEL}}
            given = NidaqmxSettings.model_validate(settings | table)
            context = OpenContext("channels.ni", daq.clock)
            return opened.enter_context(closing(open_channels(given, context, daq)))

        yield open_one
    assert daq.open_tasks == 0
