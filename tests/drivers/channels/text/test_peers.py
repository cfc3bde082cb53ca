"""The text driver reads instruments that others have simulated: by VISA, and over TCP."""

import socket
import subprocess
import time
from collections.abc import Iterator
from contextlib import closing
from typing import Any

import numpy as np
import pytest

from drivers.channels.text.driver import open_channels
from drivers.channels.text.settings import ENDS, TextChannelSettings
from drivers.clock import VirtualClock
from drivers.errors import DeviceError, DeviceFault
from drivers.interfaces import OpenContext
from tests.peers import INSTALL_S, RUN_S, interpreter

SIMULATED = pytest.importorskip("pyvisa_sim", reason="PyVISA-sim is not installed")
VOLTAGE = {"unit": "V", "range": [0.0, 10.0]}
SUPPLY = {
    "query": ":VOLT:IMM:AMPL?",
    "rate_hz": 10.0,
    "identification": {"query": "*IDN?", "pattern": "SCPI,MOCK,.*"},
    "signals": {"voltage": VOLTAGE},
}
USB = "USB0::0x1111::0x2222::0x2468::0::INSTR"
LEWIS = "from lewis.scripts.run import run_simulation; run_simulation()"
GENERATOR = {
    "rate_hz": 10.0,
    "identification": {"query": "?IDN", "pattern": "LSG Serial #1234"},
    "signals": {
        "amplitude": {"unit": "V", "range": [0.0, 10.0], "query": "?AMP"},
        "frequency": {"unit": "kHz", "range": [0.0, 100.0], "query": "?FREQ", "scale": 1e-3},
    },
}


def opened(address: str, **table: Any) -> Any:
    settings = TextChannelSettings.model_validate({"address": address, "reply_timeout_s": 0.2, **table})
    return open_channels(settings, OpenContext("channels.box", VirtualClock()))


@pytest.fixture
def set_by_hand() -> Iterator[Any]:
    """A function that sends a command to a simulated instrument, as another session of VISA."""
    import pyvisa

    manager = pyvisa.ResourceManager("@sim")

    def send(resource: str, command: str, end: str = "LF") -> None:
        with closing(manager.open_resource(resource)) as instrument:
            instrument.write_raw(command.encode() + ENDS[end])

    yield send
    manager.close()


@pytest.mark.parametrize(
    "resource", ["GPIB0::9::INSTR", "USB0::0x1111::0x2222::0x2468::0::INSTR", "ASRL2::INSTR"]
)
def test_a_power_supply_with_scpi(resource, set_by_hand):
    end = {"line_end": "CRLF"} if "ASRL" in resource else {}
    with closing(opened(f"visa://{resource}", visa_library="@sim", **SUPPLY, **end)) as supply:
        assert supply.info.model == "SCPI,MOCK,VERSION_1.0"
        for volts in (2.5, 4.125):
            set_by_hand("GPIB0::9::INSTR", f":VOLT:IMM:AMPL {volts:.3f}")
            if "GPIB" in resource:
                assert supply.read(1.0).values.tolist() == [[volts]]
        assert len(supply.read(1.0).values) == 1


@pytest.mark.parametrize("resource", ["GPIB0::8::INSTR", "TCPIP0::localhost::10001::SOCKET"])
def test_a_generator_with_a_language_of_its_own(resource, set_by_hand):
    with closing(opened(f"visa://{resource}", visa_library="@sim", **GENERATOR)) as generator:
        set_by_hand(resource, "!FREQ 2500.00")
        assert generator.read(1.0).values == pytest.approx(np.array([[1.0, 2.5]]))


def test_the_error_queue_of_another_ones_instrument_is_understood():
    errors = {"query": ":SYST:ERR?", "pattern": "0, No Error"}
    table = {**SUPPLY, "visa_library": "@sim", "errors": errors}
    with closing(opened("visa://GPIB0::4::INSTR", **table, opening=["*RST"])) as supply:
        assert supply.read(1.0).values == 1.0
    with pytest.raises(DeviceFault, match="got '1, Command error' to ':SYST:ERR\\?'"):
        opened("visa://GPIB0::4::INSTR", **table, opening=["RANG 10"])


@pytest.mark.parametrize(
    ("address", "library", "said"),
    [
        ("visa://GPIB0::30::INSTR", "@sim", "got silence; check power, cable"),
        ("visa://GPIB0::9::INSTR", "@none", "expected a VISA resource, got ValueError"),
        ("visa://nonsense", "@sim", "expected a VISA resource, got .*takes no messages; check the resource"),
    ],
)
def test_what_visa_cannot_open_is_one_sentence(address, library, said):
    with pytest.raises(DeviceError, match=said) as refused:
        opened(address, visa_library=library, **SUPPLY)
    assert "\n" not in str(refused.value)


@pytest.fixture
def thermostat() -> Iterator[str]:
    """The address of a Julabo thermostat as the neutron source ISIS simulates it (lewis)."""
    python = interpreter("lewis", "lewis==1.4.*")
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    place = f"julabo-version-1: {{bind_address: 127.0.0.1, port: {port}}}"
    process = subprocess.Popen(
        [python, "-c", LEWIS, "julabo", "-p", place, "-o", "none"], stderr=subprocess.DEVNULL
    )
    try:
        end_s = time.monotonic() + RUN_S
        while time.monotonic() < end_s:
            try:
                socket.create_connection(("127.0.0.1", port), 1.0).close()
                break
            except OSError:
                assert process.poll() is None, "lewis ended"
                time.sleep(0.1)
        yield f"socket://127.0.0.1:{port}"
    finally:
        process.kill()
        process.wait()


@pytest.mark.extended
@pytest.mark.timeout(2 * INSTALL_S + RUN_S)  # an environment is made on first use
def test_a_thermostat_on_tcp(thermostat):
    table = {
        "line_end": "CR",
        "rate_hz": 10.0,
        "identification": {"query": "VERSION", "pattern": "JULABO .*"},
        "signals": {
            "bath": {"unit": "°C", "range": [-50.0, 300.0], "query": "IN_PV_00"},
            "target": {"unit": "°C", "range": [-50.0, 300.0], "query": "IN_SP_00"},
        },
    }
    with closing(opened(thermostat, opening=["OUT_SP_00 30"], **table)) as bath:
        assert bath.info.model.startswith("JULABO")
        assert bath.read(2.0).values.tolist() == [[24.0, 30.0]]
