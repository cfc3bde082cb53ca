"""At every kind of Modbus address the search finds the register map that fits, and no machine moves."""

import socket

import pytest

from drivers.load_frames.modbus.find import modbus_at_address, modbus_at_port
from simulators.load_frame.layout import LAYOUTS
from simulators.load_frame.modbus import LoadFrameRtuServer, LoadFrameServer
from tests.tcp_servers import load_frame_rtu_on_tcp

GENERIC_STATE = b"\x04\x00\x00"
"""First bytes of a request for the block `state` of the map `generic`: function 4, address 0."""


@pytest.mark.parametrize("name", LAYOUTS)
def test_a_load_frame_is_found_with_the_map_that_fits(serve, device, name):
    server = serve(LoadFrameServer(device, layout=LAYOUTS[name], unit=1))
    (found,) = modbus_at_address(server.address)
    assert (found.usable, found.settings) == (True, {"address": server.address, "map": name})
    assert device.limits == device.ratings


def test_a_load_frame_on_a_serial_line_is_found_under_its_unit(serve, device):
    server = serve(LoadFrameRtuServer(device, unit=2))
    (found,) = modbus_at_port(server.address)
    assert found.settings["unit"] == 2
    assert found.settings["map"] == "generic"


@pytest.mark.parametrize("unit", [1, 3])
def test_a_load_frame_behind_a_gateway_is_found_as_rtu(serve, device, unit):
    server = serve(load_frame_rtu_on_tcp(device, unit=unit))
    (found,) = modbus_at_address(f"rtu://{server.address}")
    assert found.settings["address"] == f"rtu://{server.address}"
    assert found.settings.get("unit", 1) == unit


def test_a_gateway_with_nobody_behind_it_is_nobody(serve, device):
    # it answers for every unit but 9 as one that cannot reach it
    server = serve(LoadFrameServer(device, unit=9))
    assert modbus_at_address(server.address) == []


def test_a_device_that_answers_to_every_unit_is_one(serve, device):
    server = serve(LoadFrameServer(device))
    server.answer = lambda unit, request: server.registers.answer(request)
    (found,) = modbus_at_address(server.address)
    assert "unit" not in found.settings


def test_a_load_frame_whose_map_has_another_revision_is_not_taken_for_one_that_fits(serve, device):
    server = serve(LoadFrameServer(device))
    registers = server.registers.answer

    def newer(pdu: bytes) -> bytes:
        answer = registers(pdu)
        # function and byte count, then the revision
        return answer[:2] + b"\x00\x02" + answer[4:] if pdu.startswith(GENERIC_STATE) else answer

    server.registers.answer = newer
    (found,) = modbus_at_address(server.address)
    assert (found.usable, found.settings) == (False, {"address": server.address})


def test_nobody_at_an_address_is_nobody():
    with socket.create_server(("127.0.0.1", 0)) as listener:
        port = listener.getsockname()[1]
    assert modbus_at_address(f"127.0.0.1:{port}") == []
