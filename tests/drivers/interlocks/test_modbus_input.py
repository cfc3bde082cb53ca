from contextlib import closing

import pytest

from drivers.clock import VirtualClock
from drivers.errors import DeviceError, DeviceFault
from drivers.interfaces import OpenContext
from drivers.interlocks.modbus import ModbusInputSettings, open_input
from simulators.interlock.module import InputModule, InputModuleServer


@pytest.fixture
def server():
    with closing(InputModuleServer(InputModule())) as server:
        yield server


def opened(server, **settings):
    table = {"address": server.address, "reply_timeout_s": 0.5} | settings
    return closing(open_input(ModbusInputSettings(**table), OpenContext("interlocks.door", VirtualClock())))


@pytest.mark.parametrize("table", ["discrete", "coil"])
def test_a_contact_is_one_if_closed_and_zero_if_open(server, table):
    with opened(server, number=5, table=table) as contact:
        assert contact.read().value == 1.0
        server.module.set_contact(5, closed=False)
        assert contact.read().value == 0.0
        server.module.set_contact(4, closed=False)
        server.module.set_contact(5, closed=True)
        assert contact.read().value == 1.0


@pytest.mark.parametrize("table", ["input", "holding"])
def test_a_register_is_scaled_and_may_be_negative(server, table):
    server.module.set_register(3, -125)
    with opened(server, number=3, table=table, signed=True, scale=0.1, offset=1.0, quantity="°C") as oven:
        assert oven.read().value == pytest.approx(-11.5)
        assert oven.unit == "°C"


def test_an_input_that_the_module_does_not_have_is_refused_at_the_start(server):
    with pytest.raises(DeviceFault, match="illegal data address"), opened(server, number=8):
        pass


def test_a_module_that_is_gone_is_an_error_and_no_value(server):
    with opened(server, number=0) as contact:
        server.close()
        with pytest.raises(DeviceError, match=r"interlocks\.door"):
            contact.read()


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"number": 0, "scale": 0.1}, "belong to a register"),
        ({"number": 0, "invalid": [0]}, "belong to a register"),
        ({"number": 0, "table": "input", "invalid": [-1]}, "expected numbers from 0 to 65535"),
        ({"number": 0, "table": "input", "signed": True, "invalid": [0x8000]}, "from -32768 to 32767"),
        ({"number": 0, "address": "here"}, "expected host:port"),
        ({"number": 0, "address": "/dev/ttyUSB0", "unit": 0}, "from 1 to 247"),
    ],
)
def test_settings_that_contradict_each_other_are_refused(settings, said):
    with pytest.raises(ValueError, match=said):
        ModbusInputSettings(**{"address": "10.0.0.1:502"} | settings)
