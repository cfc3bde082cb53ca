"""Modbus clients of other authors read and write the simulated load frame on TCP, RTU and RTU over TCP."""

import ctypes
import ctypes.util
import struct
from collections.abc import Callable
from dataclasses import dataclass, replace

import pytest

from drivers.clock import VirtualClock
from simulators.load_frame.device import LoadFrameDevice
from simulators.load_frame.layout import GENERIC
from simulators.load_frame.modbus import LoadFrameRtuServer, LoadFrameServer
from tests.peers import program, run
from tests.spring import Spring
from tests.tcp_servers import load_frame_rtu_on_tcp

STATE_DISPLACEMENT, COMMAND, LIMIT_LOAD_MAX, WATCHDOG, HEARTBEAT = 10, 0, 34, 64, 66
SERVERS = {"tcp": LoadFrameServer, "rtu": LoadFrameRtuServer, "rtu over tcp": load_frame_rtu_on_tcp}


@dataclass
class Client:
    """The functions of another author's client; 32-bit floats have the word order of the device."""

    read_input_float: Callable[[int], float]
    read_float: Callable[[int], float]
    write_float: Callable[[int, float], object]
    write_one: Callable[[int, int], object]
    write_many: Callable[[int, list[int]], object]
    close: Callable[[], object] = lambda: None


def mbpoll(address: str, line: str, order: str) -> Client:
    path = program("mbpoll", "mbpoll")
    host, _, port = address.rpartition(":")
    where = ["-m", "tcp", "-p", port] if line == "tcp" else ["-m", "rtu", "-b", "19200", "-P", "none"]
    place = host if line == "tcp" else address
    words = ["-B"] if order == "ABCD" else []

    def read(table: str, register: int) -> float:
        what = ["-t", f"{table}:float", "-r", str(register), "-c", "1", "-1"]
        printed = run(path, *where, "-a", "1", "-0", *words, *what, place)
        (value,) = (line for line in printed.splitlines() if line.startswith(f"[{register}]"))
        return float(value.partition(":")[2])

    def write(register: int, kind: str, *values: object) -> None:
        run(path, *where, "-a", "1", "-0", *words, "-t", kind, "-r", str(register), place,
            *(str(value) for value in values))  # fmt: skip

    return Client(
        lambda register: read("3", register),
        lambda register: read("4", register),
        lambda register, value: write(register, "4:float", value),
        lambda register, value: write(register, "4", value),
        lambda register, values: write(register, "4", *values),
    )


def libmodbus(address: str, line: str, order: str) -> Client:
    name = ctypes.util.find_library("modbus")
    if name is None:
        pytest.skip("libmodbus is not on this machine (Debian: libmodbus5)")
    library = ctypes.CDLL(name)
    library.modbus_new_tcp.restype = library.modbus_new_rtu.restype = ctypes.c_void_p
    host, _, port = address.rpartition(":")
    new = (
        library.modbus_new_tcp(host.encode(), int(port))
        if line == "tcp"
        else library.modbus_new_rtu(address.encode(), 19200, ctypes.c_char(b"N"), 8, 1)
    )
    context = ctypes.c_void_p(new)
    decode = getattr(library, f"modbus_get_float_{order.lower()}")
    decode.restype = ctypes.c_float
    assert library.modbus_set_slave(context, 1) == 0
    assert library.modbus_connect(context) == 0

    def read(function: str, register: int) -> float:
        words = (ctypes.c_uint16 * 2)()
        assert getattr(library, function)(context, register, 2, words) == 2
        return float(decode(words))

    def write(register: int, values: list[int]) -> None:
        words = (ctypes.c_uint16 * len(values))(*values)
        assert library.modbus_write_registers(context, register, len(values), words) == len(values)

    def close() -> None:
        library.modbus_close(context)
        library.modbus_free(context)

    return Client(
        lambda register: read("modbus_read_input_registers", register),
        lambda register: read("modbus_read_registers", register),
        # not by modbus_set_float_*, which in version 3.1.6 exchange the bytes of each word
        lambda register, value: write(register, _parted(value, order)),
        lambda register, value: library.modbus_write_register(context, register, value),
        write,
        close,
    )


def pymodbustcp(address: str, line: str, order: str) -> Client:
    from pyModbusTCP.client import ModbusClient
    from pyModbusTCP.utils import decode_ieee, encode_ieee, long_list_to_word, word_list_to_long

    host, _, port = address.rpartition(":")
    client = ModbusClient(host=host, port=int(port), unit_id=1, timeout=10.0)
    high_first = order == "ABCD"

    def number(words: list[int] | None) -> float:
        assert words, client.last_error_as_txt
        return float(decode_ieee(word_list_to_long(words, big_endian=high_first)[0]))

    def write_float(register: int, value: float) -> None:
        words = long_list_to_word([encode_ieee(value)], big_endian=high_first)
        assert client.write_multiple_registers(register, words)

    return Client(
        lambda register: number(client.read_input_registers(register, 2)),
        lambda register: number(client.read_holding_registers(register, 2)),
        write_float,
        client.write_single_register,
        client.write_multiple_registers,
        client.close,
    )


def modbus_tk(address: str, line: str, order: str) -> Client:
    import serial
    from modbus_tk import defines, modbus_rtu, modbus_rtu_over_tcp, modbus_tcp

    host, _, port = address.rpartition(":")
    if line == "rtu":
        master = modbus_rtu.RtuMaster(serial.Serial(address, 19200, exclusive=True))
    else:
        kind = modbus_tcp.TcpMaster if line == "tcp" else modbus_rtu_over_tcp.RtuOverTcpMaster
        master = kind(host, int(port))
    master.set_timeout(10.0)
    master.open()

    def number(function: int, register: int) -> float:
        return float(_joined(list(master.execute(1, function, register, 2)), order))

    def write(register: int, values: list[int]) -> None:
        assert master.execute(1, defines.WRITE_MULTIPLE_REGISTERS, register, output_value=values)

    return Client(
        lambda register: number(defines.READ_INPUT_REGISTERS, register),
        lambda register: number(defines.READ_HOLDING_REGISTERS, register),
        lambda register, value: write(register, _parted(value, order)),
        lambda register, value: master.execute(
            1, defines.WRITE_SINGLE_REGISTER, register, output_value=value
        ),
        write,
        master.close,
    )  # fmt: skip


def minimalmodbus(address: str, line: str, order: str) -> Client:
    import minimalmodbus as theirs

    instrument = theirs.Instrument(address, 1)
    instrument.serial.timeout = 10.0
    byte_order = theirs.BYTEORDER_BIG if order == "ABCD" else theirs.BYTEORDER_LITTLE_SWAP
    return Client(
        lambda register: instrument.read_float(register, functioncode=4, byteorder=byte_order),
        lambda register: instrument.read_float(register, functioncode=3, byteorder=byte_order),
        lambda register, value: instrument.write_float(register, value, byteorder=byte_order),
        lambda register, value: instrument.write_register(register, value, functioncode=6),
        instrument.write_registers,
        instrument.serial.close,
    )


def _joined(words: list[int], order: str) -> float:
    high, low = words if order == "ABCD" else reversed(words)
    return float(struct.unpack(">f", struct.pack(">HH", high, low))[0])


def _parted(value: float, order: str) -> list[int]:
    words = list(struct.unpack(">HH", struct.pack(">f", value)))
    return words if order == "ABCD" else words[::-1]


PEERS = [
    (mbpoll, "tcp"), (mbpoll, "rtu"), (libmodbus, "tcp"), (libmodbus, "rtu"), (pymodbustcp, "tcp"),
    (modbus_tk, "tcp"), (modbus_tk, "rtu"), (modbus_tk, "rtu over tcp"), (minimalmodbus, "rtu"),
]  # fmt: skip


@pytest.mark.parametrize("order", ["ABCD", "CDAB"])
@pytest.mark.parametrize(("peer", "line"), PEERS, ids=[f"{peer.__name__} {line}" for peer, line in PEERS])
def test_others_read_and_write_the_simulated_frame(peer, line, order, serve):
    clock = VirtualClock()
    device = LoadFrameDevice(clock, Spring())
    server = serve(SERVERS[line](device, layout=replace(GENERIC, word_order=order)))
    client = peer(server.address, line, order)
    try:
        device.go_to_displacement(0.625, 0.5)
        clock.sleep(10.0)
        assert client.read_input_float(STATE_DISPLACEMENT) == 0.625
        assert client.read_input_float(STATE_DISPLACEMENT - 2) == 3125.0
        assert client.read_float(LIMIT_LOAD_MAX) == 50_000.0
        client.write_float(WATCHDOG, 2.5)
        assert device.watchdog_s == 2.5
        client.write_one(HEARTBEAT, 77)
        assert device.heartbeat == 77
        words = [2, *_parted(0.75, order), *_parted(0.5, order), 0, 0, 0, 0, 9]
        client.write_many(COMMAND, words)
        clock.sleep(1.0)
        assert device.displacement_mm() == pytest.approx(0.75, rel=1e-12)
    finally:
        client.close()
