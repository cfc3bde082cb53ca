"""Modbus clients of other authors read the simulated box, and switch its outputs."""

import struct

import pytest

from drivers.clock import VirtualClock
from simulators.closed_machine.box import AnalogueBox
from simulators.closed_machine.modbus import AnalogueBoxRtuServer, AnalogueBoxServer
from simulators.wire.ports import LOCALHOST
from tests.drivers.box import ByHand
from tests.simulators.load_frame.test_peers import PEERS

SERVERS = {
    "tcp": AnalogueBoxServer,
    "rtu": AnalogueBoxRtuServer,
    "rtu over tcp": lambda box: AnalogueBoxRtuServer(box, host=LOCALHOST),
}
FIRST = {"ABCD": 0, "CDAB": 20}


def box_by_hand():
    hand = ByHand()
    hand.inputs = {"force": 2.5, "crosshead": -1.5, "extensometer": 0.375}
    hand.pulses = 70_000
    return AnalogueBox(VirtualClock(), hand)


@pytest.mark.parametrize("order", FIRST)
@pytest.mark.parametrize(("peer", "line"), PEERS, ids=[f"{peer.__name__} {line}" for peer, line in PEERS])
def test_others_read_the_voltages_and_write_an_output(peer, line, order, serve):
    box = box_by_hand()
    server = serve(SERVERS[line](box))
    client = peer(server.address, line, order)
    try:
        first = FIRST[order]
        assert client.read_input_float(first) == 2.5
        assert client.read_input_float(first + 2) == -1.5
        assert client.read_float(first + 4) == 0.375
        client.write_one(1000, 77)
        client.write_many(1002, [8, 9])
        assert [box.output(place) for place in range(4)] == [77, 0, 8, 9]
    finally:
        client.close()


def test_pymodbus_reads_everything_and_switches_coils(serve):
    from pymodbus.client import ModbusTcpClient

    box = box_by_hand()
    host, _, port = serve(AnalogueBoxServer(box)).address.rpartition(":")
    client = ModbusTcpClient(host, port=int(port))
    assert client.connect()
    try:
        volts = client.read_input_registers(0, count=6).registers
        assert struct.unpack(">3f", struct.pack(">6H", *volts)) == (2.5, -1.5, 0.375)
        assert client.read_holding_registers(60, count=2).registers == [1, 70_000 - 65_536]
        assert client.read_discrete_inputs(0, count=2).bits[:2] == [False, False]
        assert not client.write_coil(5, True).isError()
        assert client.read_coils(0, count=8).bits[:8] == [number == 5 for number in range(8)]
        assert not client.write_coils(0, [True, False, True]).isError()
        assert [box.coil(number) for number in range(8)] == [number in (0, 2, 5) for number in range(8)]
        assert client.read_input_registers(500, count=1).exception_code == 2
    finally:
        client.close()


def test_modbus_tk_reads_contacts_and_switches_a_coil(serve):
    from modbus_tk import defines, modbus_tcp

    box = box_by_hand()
    host, _, port = serve(AnalogueBoxServer(box)).address.rpartition(":")
    master = modbus_tcp.TcpMaster(host, int(port))
    master.set_timeout(10.0)
    try:
        assert master.execute(1, defines.READ_DISCRETE_INPUTS, 0, 2) == (0, 0)
        assert master.execute(1, defines.WRITE_SINGLE_COIL, 2, output_value=1)
        assert master.execute(1, defines.READ_COILS, 0, 8) == (0, 0, 1, 0, 0, 0, 0, 0)
        assert box.coil(2)
    finally:
        master.close()
