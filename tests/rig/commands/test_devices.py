"""`rig devices` with simulated devices at real ports, and a system folder made by hand."""

import json
import socket
import sys
import tomllib
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest
import serial.tools.list_ports
from serial.tools.list_ports_common import ListPortInfo

import drivers.probe
import rig.commands.devices
from drivers.clock import VirtualClock
from drivers.errors import ConfigurationError
from drivers.lines.serial_ports import FoundCamera, serial_ports, video_nodes
from drivers.load_frames.modbus.registers.map import RegisterMap
from drivers.probe import probe_modbus_tcp, probe_serial
from rig.cli import main
from rig.commands.devices import search
from rig.rigfile import read_rig
from simulators.load_frame.device import LoadFrameDevice
from simulators.load_frame.layout import LAYOUTS
from simulators.load_frame.modbus import LoadFrameRtuServer, LoadFrameRtuTcpServer, LoadFrameServer
from simulators.stage.device import StageDevice
from simulators.stage.newport import NewportServer
from simulators.stage.zaber import StageServer, StageTcpServer
from tests.spring import Spring


@pytest.fixture
def serve() -> Iterator[Callable[[Any], Any]]:
    with ExitStack() as stack:

        def start(server: Any) -> Any:
            stack.callback(server.close)
            return server

        yield start


@pytest.fixture
def clock() -> VirtualClock:
    return VirtualClock()


@pytest.fixture
def call(monkeypatch, capsys):
    camera = FoundCamera("v4l2", "/dev/video7", "a camera")
    monkeypatch.setattr(rig.commands.devices, "video_nodes", lambda: [camera])
    monkeypatch.setattr(rig.commands.devices, "vision_cameras", list)
    monkeypatch.setattr(rig.commands.devices, "serial_ports", list)

    def run(*arguments: object) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["rig", "devices", *map(str, arguments)])
        with pytest.raises(SystemExit) as ended:
            main()
        out, err = capsys.readouterr()
        return ended.value.code, out, err

    return run


def test_devices_of_every_kind_are_found_and_nothing_moves(serve, clock):
    stage, other = StageDevice(clock), StageDevice(clock)
    zaber = serve(StageServer(stage, device_address=3, serial=4711))
    (found,) = probe_serial(zaber.address)
    assert (found.kind, found.driver) == ("stage", "zaber-ascii")
    assert found.settings == {"port": zaber.address, "address": 3}
    assert "4711" in found.what
    newport = serve(NewportServer(other, clock))
    (found,) = probe_serial(newport.address)
    assert (found.driver, found.settings) == ("newport-esp301", {"port": newport.address, "baud": 921_600})
    clock.sleep(10.0)
    assert (stage.position, other.position) == (0, 0)


@pytest.mark.parametrize("name", LAYOUTS)
def test_a_load_frame_is_found_with_the_map_that_fits(serve, clock, name):
    device = LoadFrameDevice(clock, Spring())
    server = serve(LoadFrameServer(device, layout=LAYOUTS[name], unit=1))
    (found,) = probe_modbus_tcp(server.address)
    assert (found.driver, found.settings) == ("modbus-frame", {"address": server.address, "map": name})
    assert device.limits == device.ratings


def test_a_load_frame_on_a_serial_line_is_found_under_its_unit(serve, clock):
    server = serve(LoadFrameRtuServer(LoadFrameDevice(clock, Spring()), unit=2))
    (found,) = probe_serial(server.address)
    assert found.settings["unit"] == 2
    assert found.settings["map"] == "generic"


def test_a_gateway_with_nobody_behind_it_is_nobody(serve, clock):
    # it answers for every unit but 9 as one that cannot reach it
    server = serve(LoadFrameServer(LoadFrameDevice(clock, Spring()), unit=9))
    assert probe_modbus_tcp(server.address) == []


def test_a_device_that_answers_to_every_unit_is_one(serve, clock):
    server = serve(LoadFrameServer(LoadFrameDevice(clock, Spring())))
    server.answer = lambda unit, request: server.registers.answer(request)
    (found,) = probe_modbus_tcp(server.address)
    assert "unit" not in found.settings


def test_a_frame_whose_map_has_another_revision_is_not_taken_for_one_that_fits(serve, clock, monkeypatch):
    server = serve(LoadFrameServer(LoadFrameDevice(clock, Spring())))
    shipped = drivers.probe.load_map

    def newer(name: str) -> RegisterMap:
        register_map = shipped(name)
        return register_map.model_copy(update={"revision": register_map.revision + 1})

    monkeypatch.setattr(drivers.probe, "load_map", newer)
    (found,) = probe_modbus_tcp(server.address)
    assert (found.driver, found.settings) == ("", {"address": server.address})


def test_nobody_at_an_address_is_nobody():
    with socket.create_server(("127.0.0.1", 0)) as listener:
        port = listener.getsockname()[1]
    assert probe_modbus_tcp(f"127.0.0.1:{port}") == []


def test_the_rig_file_to_start_from_lacks_only_what_a_person_must_decide(serve, clock, call, tmp_path):
    zaber = serve(StageServer(StageDevice(clock)))
    frame = serve(LoadFrameServer(LoadFrameDevice(clock, Spring())))
    path, table = tmp_path / "rig.toml", tmp_path / "devices.json"
    status, out, err = call("--port", zaber.address, "--modbus", frame.address, "-o", path, "--json", table)
    assert (status, err) == (0, "")
    assert "camera /dev/video7: a camera" in out
    assert "Zaber device 1, serial number 110001" in out
    assert json.loads(table.read_text())["modbus"][0]["found"][0]["settings"]["map"] == "generic"
    with pytest.raises(ConfigurationError) as missing:
        read_rig(path)
    assert all(mistake.endswith("is missing; add it") for mistake in missing.value.mistakes)
    names = {mistake.partition(":")[0].rpartition(".")[2] for mistake in missing.value.mistakes}
    assert {"angle_min_deg", "angle_max_deg", "load_max_n", "displacement_max_mm"} <= names
    text = path.read_text()
    for line, decision in (
        ("# angle_min_deg, angle_max_deg: ", "angle_min_deg = -5.0\nangle_max_deg = 365.0\n# "),
        ("# load_max_n, displacement_max_mm: ", "load_max_n = 2e3\ndisplacement_max_mm = 4.0\n# "),
        ("# format, width_px, ", "width_px = 640\nheight_px = 480\nrate_hz = 30.0\n# "),
    ):
        assert line in text
        text = text.replace(line, decision)
    path.write_text(text)
    decided = read_rig(path)
    assert decided.stage is not None
    assert decided.stage.setting("port") == zaber.address
    assert decided.cameras["camera_0"].setting("device") == "/dev/video7"


def test_a_rig_file_that_is_there_is_kept(call, tmp_path):
    path = tmp_path / "rig.toml"
    path.write_text("mine")
    status, _, err = call("-o", path)
    assert status == 2
    assert "expected a new file" in err
    assert path.read_text() == "mine"


def test_no_probe_sends_nothing(serve, clock, call):
    zaber = serve(StageServer(StageDevice(clock)))
    frame = serve(LoadFrameServer(LoadFrameDevice(clock, Spring())))
    heard: list[bytes] = []
    zaber.respond = frame.respond = lambda message: heard.append(message) or b""
    status, out, _ = call("--port", zaber.address, "--modbus", frame.address, "--no-probe")
    assert (status, heard) == (0, [])
    assert out.count("not asked") == 3


def test_a_stage_behind_tcp_is_found_and_named_once(serve, clock, call):
    zaber = serve(StageTcpServer(StageDevice(clock)))
    place = f"socket://{zaber.address}"
    status, out, _ = call("--port", place, "--port", place)
    assert status == 0
    assert out.count(f"serial port {place} (named): Zaber device 1, serial number 110001") == 1
    zaber.close()
    _, out, _ = call("--port", place)
    assert "Connection refused" in out


@pytest.mark.parametrize("unit", [1, 3])
def test_a_frame_behind_a_gateway_is_found_as_rtu(serve, clock, unit):
    server = serve(LoadFrameRtuTcpServer(LoadFrameDevice(clock, Spring()), unit=unit))
    (found,) = probe_modbus_tcp(f"rtu://{server.address}")
    assert found.settings["address"] == f"rtu://{server.address}"
    assert found.settings.get("unit", 1) == unit


def test_a_modbus_device_of_no_known_map_does_not_stand_for_the_load_frame(serve, clock, call, tmp_path):
    thermometer = serve(LoadFrameServer(LoadFrameDevice(clock, Spring()), serial=1))
    registers = thermometer.registers.answer
    # it has registers for whoever asks for one, and no blocks
    thermometer.registers.answer = lambda pdu: registers(pdu) if pdu[-2:] == b"\x00\x01" else b"\x84\x02"
    frame = serve(LoadFrameServer(LoadFrameDevice(clock, Spring())))
    path = tmp_path / "rig.toml"
    status, out, _ = call("--modbus", thermometer.address, "--modbus", frame.address, "-o", path)
    assert status == 0
    assert "which no shipped register map fits" in out
    load_frame = tomllib.loads(path.read_text())["load_frame"]
    assert load_frame["address"] == frame.address
    assert f'# address = "{thermometer.address}"' in path.read_text()


@pytest.mark.parametrize(
    "address", ["", "::1", "a:b", "host:", "host:0", "host:65536", "/dev/ttyS0", "rtu://", "a b"]
)
def test_an_address_that_is_none_is_refused_before_anybody_is_asked(call, monkeypatch, address):
    monkeypatch.setattr(rig.commands.devices, "serial_ports", lambda: pytest.fail("was asked"))
    status, out, err = call("--modbus", address)
    assert (status, out) == (2, "")
    assert f"expected --modbus HOST[:PORT] or rtu://HOST[:PORT], got {address!r}" in err


@pytest.mark.parametrize(
    ("written", "asked"),
    [
        ("frame", "frame:502"),
        ("10.0.0.7:1502", "10.0.0.7:1502"),
        ("[fe80::1]", "[fe80::1]:502"),
        ("rtu://gate:4001", "rtu://gate:4001"),
    ],
)
def test_an_address_without_a_port_gets_that_of_the_standard(written, asked):
    assert search([], [written], ask=False).hosts == [(asked, [], "not asked")]


def test_a_rig_file_without_cameras_says_that_they_are_missing(call, monkeypatch, tmp_path):
    monkeypatch.setattr(rig.commands.devices, "video_nodes", list)
    call("-o", tmp_path / "rig.toml")
    assert "# No camera was found: add [cameras.NAME]" in (tmp_path / "rig.toml").read_text()


def test_a_port_that_is_not_there_is_told(call):
    status, out, err = call("--port", "/dev/ttyNone")
    assert (status, err) == (0, "")
    assert "/dev/ttyNone (named): cannot be opened" in out


def test_serial_ports_are_named_by_what_lasts(tmp_path, monkeypatch):
    links = {
        "by-id/usb-FTDI_A1-if00": "ttyUSB0",
        "by-id/usb-1a86_USB_Serial-if00": "ttyUSB2",
        "by-path/pci-usb-0:1": "ttyUSB0",
        "by-path/pci-usb-0:2": "ttyUSB1",
        "by-path/pci-usb-0:3": "ttyUSB2",
    }
    for name, node in links.items():
        link = tmp_path / "dev/serial" / name
        link.parent.mkdir(parents=True, exist_ok=True)
        link.symlink_to(f"../../{node}")
    # two adapters of a kind without a serial number share one name in by-id
    plugged = {"ttyUSB0": "A1", "ttyUSB1": None, "ttyUSB2": None}
    ports = [ListPortInfo(f"/dev/{name}") for name in plugged]
    for port, number in zip(ports, plugged.values(), strict=True):
        port.serial_number = number
    monkeypatch.setattr(serial.tools.list_ports, "comports", lambda: ports)
    found = [port.path.removeprefix(f"{tmp_path}/dev/serial/") for port in serial_ports(tmp_path)]
    assert found == ["by-id/usb-FTDI_A1-if00", "by-path/pci-usb-0:2", "by-path/pci-usb-0:3"]


def test_of_a_cameras_names_its_sockets_is_taken(tmp_path):
    folder = tmp_path / "sys/class/video4linux/video0"
    folder.mkdir(parents=True)
    for kind in ("by-id", "by-path"):
        links = tmp_path / "dev/v4l" / kind
        links.mkdir(parents=True)
        (links / "camera").symlink_to("../../video0")
    assert [node.place for node in video_nodes(tmp_path)] == [str(tmp_path / "dev/v4l/by-path/camera")]


def test_video_nodes_are_named_by_what_lasts(tmp_path):
    nodes = {"video0": ("0", "USB camera"), "video1": ("1", "USB camera"), "video10": ("0", "second")}
    for name, (index, label) in nodes.items():
        folder = tmp_path / "sys/class/video4linux" / name
        folder.mkdir(parents=True)
        (folder / "index").write_text(index + "\n")
        (folder / "name").write_text(label + "\n")
    links = tmp_path / "dev/v4l/by-id"
    links.mkdir(parents=True)
    (links / "usb-Camera_1234-video-index0").symlink_to("../../video0")
    assert video_nodes(tmp_path) == [
        FoundCamera("v4l2", str(links / "usb-Camera_1234-video-index0"), "USB camera"),
        FoundCamera("v4l2", "/dev/video10", "second"),
    ]
    assert video_nodes(Path("/nowhere")) == []
