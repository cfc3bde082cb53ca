"""The drivers of Modbus boxes talk to servers by other authors."""

import socket
import struct
from contextlib import closing, contextmanager

import pytest

from drivers.channels.modbus import ModbusChannelsSettings, open_channels
from drivers.interfaces import OpenContext
from drivers.triggers.modbus import ModbusPulseSettings, open_pulse
from tests.drivers.box import WatchedBox
from tests.drivers.load_frames.foreign_servers import (
    LibmodbusRtuServer,
    LibmodbusTcpServer,
    PyModbusTcpServer,
    TkRtuServer,
    TkTcpServer,
    libmodbus,
)

SERVERS = [PyModbusTcpServer, TkTcpServer, TkRtuServer, LibmodbusTcpServer, LibmodbusRtuServer]
SIGNALS = {
    "force": {"input": 0, "type": "f32", "unit": "V", "range": [-11, 11]},
    "crosshead": {"input": 22, "type": "f32", "word_order": "CDAB", "unit": "V", "range": [-11, 11]},
    "strain": {"input": 42, "type": "i16", "table": "holding", "unit": "1", "range": [-32768, 32767]},
    "trigger": {"input": 60, "type": "u32", "unit": "1", "range": [0, 4e9]},
}


@pytest.fixture(params=SERVERS, ids=lambda kind: kind.__name__)
def foreign(request, clock):
    if "Libmodbus" in request.param.__name__ and libmodbus() is None:
        pytest.skip("libmodbus is not on this machine (Debian: libmodbus5)")
    server, server.box = request.param(), WatchedBox(clock)
    server.answer = server.box.answer
    with closing(server):
        yield server


def settings_of(server, model, **table):
    parity = {"parity": "N"} if server.address.startswith("/") else {}
    return model.model_validate({"address": server.address, "reply_timeout_s": 5.0} | table | parity)


def test_channels_read_the_registers(foreign, clock):
    foreign.box.hand.inputs = {"force": 2.5, "crosshead": -1.5, "extensometer": -3.0}
    foreign.box.hand.pulses = 70_000
    settings = settings_of(foreign, ModbusChannelsSettings, rate_hz=10.0, signals=SIGNALS)
    with closing(open_channels(settings, OpenContext("channels.box", clock))) as device:
        for number in range(3):
            samples = device.read(10.0)
            assert (samples.first, samples.values.tolist()) == (number, [[2.5, -1.5, -9000.0, 70_000.0]])


def test_pulses_are_given_by_a_register(foreign, clock):
    settings = settings_of(foreign, ModbusPulseSettings, output=1001, table="holding", width_s=0.05)
    with closing(open_pulse(settings, OpenContext("triggers.logger", clock))) as trigger:
        trigger.pulse()
    assert [(number, on) for _, number, on in foreign.box.edges] == [(1001, True), (1001, False)]


@contextmanager
def coils_by_pymodbustcp():
    from pyModbusTCP.server import DataBank, ModbusServer

    seen = []

    class Bank(DataBank):
        def on_coils_change(self, address, from_value, to_value, srv_info):
            seen.append((address, to_value))

    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    server = ModbusServer("127.0.0.1", port, no_block=True, data_bank=Bank())
    server.start()
    try:
        yield f"127.0.0.1:{port}", seen
    finally:
        server.stop()


def test_pulses_are_given_by_a_coil(clock):
    with coils_by_pymodbustcp() as (address, seen):
        settings = ModbusPulseSettings(address=address, output=4, width_s=0.05, reply_timeout_s=5.0)
        with closing(open_pulse(settings, OpenContext("triggers.logger", clock))) as trigger:
            trigger.pulse()
    assert seen == [(4, True), (4, False)]


def test_a_labjack_is_read_as_the_page_says(foreign, clock):
    """Its inputs are 32-bit floats, the most significant word first, at 0, 2, 4 and so on."""
    foreign.answer = lambda request: (
        bytes([request[0], 8]) + struct.pack(">2f", 1.25, -9999.0)
        if request == struct.pack(">BHH", request[0], 0, 4)
        else bytes([request[0] | 0x80, 2])
    )
    labjack = {"type": "f32", "unit": "V", "range": [-10.4, 10.4], "invalid": [-9999]}
    signals = {"ain0": labjack | {"input": 0}, "ain1": labjack | {"input": 2}}
    settings = settings_of(foreign, ModbusChannelsSettings, rate_hz=10.0, signals=signals)
    with closing(open_channels(settings, OpenContext("channels.labjack", clock))) as device:
        first, second = device.read(10.0).values[0]
    assert first == 1.25
    assert second != second
