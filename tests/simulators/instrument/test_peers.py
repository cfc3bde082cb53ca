"""Clients of other authors read the simulated meter."""

from contextlib import closing

import pytest
import serial

from drivers.clock import SystemClock
from simulators.instrument.meter import IDENTITY, NO_ERROR, UNDEFINED, Meter, MeterServer, SendingMeterServer
from simulators.wire.ports import LOCALHOST

VALUES = {"force": 12.5, "travel": -0.25}
READING = "+1.250000E+01,-2.500000E-01"


@pytest.fixture
def meter():
    return Meter(SystemClock(), VALUES)


def test_pyserial_asks_it_on_a_pseudo_terminal(meter, serve):
    server = serve(MeterServer(meter))
    with serial.Serial(server.address, timeout=2.0) as port:

        def asked(message: str) -> str:
            port.write(message.encode() + b"\r\n")
            return port.readline().decode().strip()

        assert asked("*IDN?") == IDENTITY
        assert asked("READ?") == READING
        assert asked("TRAVEL?") == "travel= -2.500000E-01 unit"
        port.write(b"CNOF:VOLT\n")
        assert [asked("SYST:ERR?") for _ in range(2)] == [UNDEFINED, NO_ERROR]


def test_pyserial_hears_it_send_by_itself(meter, serve):
    server = serve(SendingMeterServer(meter, 200.0))
    with serial.Serial(server.address, timeout=2.0) as port:
        port.readline()
        lines = [port.readline().decode().strip().split(",", 2) for _ in range(5)]
    numbers = [int(counter) for _, counter, _ in lines]
    assert numbers == list(range(numbers[0], numbers[0] + 5))
    assert {values for _, _, values in lines} == {READING}
    times_ms = [float(time) for time, _, _ in lines]
    assert times_ms == sorted(times_ms)


@pytest.mark.parametrize("host", [None, LOCALHOST], ids=["pty", "tcp"])
def test_pyvisa_py_asks_it(meter, serve, host):
    pytest.importorskip("pyvisa_py", reason="PyVISA-py of the extra [visa] is not installed")
    import pyvisa

    server = serve(MeterServer(meter, host=host))
    place = server.address.replace(":", "::")
    name = f"ASRL{place}::INSTR" if host is None else f"TCPIP0::{place}::SOCKET"
    with closing(pyvisa.ResourceManager("@py").open_resource(name)) as instrument:
        instrument.read_termination, instrument.write_termination = "\r\n", "\n"
        assert instrument.query("*IDN?") == IDENTITY
        assert instrument.query_ascii_values("READ?") == [12.5, -0.25]
