"""`rig devices` with simulated devices at real ports, and with a simulated system folder."""

import tomllib
from collections.abc import Callable
from dataclasses import replace

import pytest

from drivers.errors import ConfigurationError
from drivers.registry import DriverSpec, Finder, Found, SerialPort, find_driver
from drivers.settings import Settings
from rig.commands import device_search
from rig.commands.device_search import search
from rig.commands.devices import lines, rig_file
from rig.rigfile import read_rig
from simulators.load_frame.device import LoadFrameDevice
from simulators.load_frame.modbus import LoadFrameServer
from simulators.stage.device import StageDevice
from simulators.stage.zaber import ZaberServer
from tests.command_line import run_rig
from tests.spring import Spring
from tests.tcp_servers import zaber_on_tcp

VISION = "GigE Vision and USB3 Vision cameras"


@pytest.fixture(autouse=True)
def finders(monkeypatch) -> dict[str, Finder | None]:
    """Replace the drivers' search functions: they find one camera, and list no serial ports."""
    replaced: dict[str, Finder | None] = {
        "v4l2": Finder("V4L2 cameras", listed=lambda: [Found("a camera", {"device": "/dev/video7"})]),
        "aravis": Finder(VISION, answering=list),
        "gentl": None,
    }

    def driver(name: str) -> DriverSpec:
        spec = find_driver(name)
        ours = None if spec.find is None else replace(spec.find, ports=None)
        return replace(spec, find=replaced.get(name, ours))

    monkeypatch.setattr(device_search, "find_driver", driver)
    return replaced


def test_the_rig_file_to_start_from_lacks_only_what_a_person_must_decide(serve, clock, tmp_path):
    zaber = serve(ZaberServer(StageDevice(clock)))
    frame = serve(LoadFrameServer(LoadFrameDevice(clock, Spring())))
    path, table = tmp_path / "rig.toml", tmp_path / "devices.json"
    done = run_rig("devices", "--port", zaber.address, "--modbus", frame.address, "-o", path, "--json", table)
    assert (done.status, done.err) == (0, "")
    assert "camera /dev/video7: a camera" in done.out
    assert "Zaber device 1, serial number 110001" in done.out
    assert done.report["modbus"][0]["found"][0]["settings"]["map"] == "generic"
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


def test_a_rig_file_that_is_there_is_kept(tmp_path):
    path = tmp_path / "rig.toml"
    path.write_text("mine")
    done = run_rig("devices", "-o", path)
    assert done.status == 2
    assert "one that exists" in done.err
    assert path.read_text() == "mine"


def test_no_probe_sends_nothing(serve, clock):
    zaber = serve(ZaberServer(StageDevice(clock)))
    frame = serve(LoadFrameServer(LoadFrameDevice(clock, Spring())))
    heard: list[bytes] = []
    zaber.respond = frame.respond = lambda message: heard.append(message) or b""
    done = run_rig("devices", "--port", zaber.address, "--modbus", frame.address, "--no-probe")
    assert (done.status, heard) == (0, [])
    assert done.out.count("not asked") == 3


def test_a_stage_behind_tcp_is_found_and_named_once(serve, clock):
    zaber = serve(zaber_on_tcp(StageDevice(clock)))
    place = f"socket://{zaber.address}"
    done = run_rig("devices", "--port", place, "--port", place)
    assert done.status == 0
    assert done.out.count(f"serial port {place} (named): Zaber device 1, serial number 110001") == 1
    zaber.close()
    done = run_rig("devices", "--port", place)
    assert "Connection refused" in done.out


def test_a_modbus_device_of_no_known_map_does_not_stand_for_the_load_frame(serve, clock, tmp_path):
    thermometer = serve(LoadFrameServer(LoadFrameDevice(clock, Spring()), serial=1))
    registers = thermometer.registers.answer
    # it has registers for whoever asks for one, and no blocks
    thermometer.registers.answer = lambda pdu: registers(pdu) if pdu[-2:] == b"\x00\x01" else b"\x84\x02"
    frame = serve(LoadFrameServer(LoadFrameDevice(clock, Spring())))
    path = tmp_path / "rig.toml"
    done = run_rig("devices", "--modbus", thermometer.address, "--modbus", frame.address, "-o", path)
    assert done.status == 0
    assert "which no shipped register map fits" in done.out
    load_frame = tomllib.loads(path.read_text())["load_frame"]
    assert load_frame["address"] == frame.address
    assert f'# address = "{thermometer.address}"' in path.read_text()


@pytest.mark.parametrize(
    "address", ["", "::1", "a:b", "host:", "host:0", "host:65536", "/dev/ttyS0", "rtu://", "a b"]
)
def test_an_address_that_is_none_is_refused_before_anybody_is_asked(monkeypatch, address):
    monkeypatch.setattr(device_search, "find_driver", lambda name: pytest.fail("was asked"))
    done = run_rig("devices", "--modbus", address)
    assert (done.status, done.out) == (2, "")
    assert f"expected --modbus HOST[:PORT] or rtu://HOST[:PORT], got {address!r}" in done.err


@pytest.mark.parametrize(
    ("written", "asked"),
    [
        ("frame", "frame:502"),
        ("10.0.0.7:1502", "10.0.0.7:1502"),
        ("[fe80::1]", "[fe80::1]:502"),
        ("rtu://gate:4001", "rtu://gate:4001"),
    ],
)
def test_an_address_without_a_port_gets_that_of_the_standard(finders, written, asked):
    (place,) = search([], [written], ask=False).modbus
    assert (place.address, place.devices, place.trouble) == (asked, [], "not asked")


def test_a_rig_file_without_cameras_says_that_they_are_missing(finders, tmp_path):
    finders["v4l2"] = None
    run_rig("devices", "-o", tmp_path / "rig.toml")
    assert "# No camera was found: add [cameras.NAME]" in (tmp_path / "rig.toml").read_text()


def test_a_port_that_is_not_there_is_told():
    done = run_rig("devices", "--port", "/dev/ttyNone")
    assert (done.status, done.err) == (0, "")
    assert "/dev/ttyNone (named): cannot be opened" in done.out


def test_cameras_that_answer_on_networks_stand_in_the_rig_file_with_their_driver(finders, tmp_path):
    finders["v4l2"] = None
    cameras = [Found("Maker Mono 7", {"camera": "Maker-7"}), Found("Other Usb 8", {"camera": "Other-8"})]
    finders["aravis"] = Finder(VISION, answering=lambda: cameras)
    found = search([], [], ask=True)
    assert lines(found)[:2] == ["camera Maker-7: Maker Mono 7", "camera Other-8: Other Usb 8"]
    path = tmp_path / "rig.toml"
    decided = "width_px = 640\nheight_px = 480\nrate_hz = 25.0\nexposure_us = 5000.0\n# format"
    path.write_text(rig_file(found).replace("# format", decided))
    read = read_rig(path).cameras
    assert [camera.driver for camera in read.values()] == ["aravis", "aravis"]
    assert read["camera_0"].setting("camera") == "Maker-7"


def test_what_was_not_looked_for_is_said(finders, tmp_path):
    def missing() -> list[Found]:
        raise OSError("no library; install it")

    finders["aravis"] = Finder(VISION, answering=missing)
    assert f"{VISION}: no library; install it" in lines(search([], [], ask=True))
    assert f"{VISION}: not asked" in lines(search([], [], ask=False))
    table = run_rig("devices", "--json", tmp_path / "found.json").report
    assert table["cameras_not_looked_for"] == "no library; install it"


def test_a_camera_cannot_write_into_the_rig_file_by_its_name(finders):
    spiteful = Found("Maker\n[stage]\x1b[2J", {"camera": "Maker-7"})
    finders["aravis"] = Finder(VISION, answering=lambda: [spiteful])
    content = tomllib.loads(rig_file(search([], [], ask=True)))
    assert set(content) == {"rig", "cameras", "operator"}


class TheirSettings(Settings):
    """Rig-file settings of a third party's stage."""

    port: str
    gear: int


class Asked:
    """Stage drivers of a third party that record in `order` which driver queries which port."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.order: list[tuple[str, str]] = []
        self.specs: dict[str, DriverSpec] = {}
        monkeypatch.setattr(device_search, "driver_names", lambda: sorted(self.specs))
        monkeypatch.setattr(device_search, "find_driver", self.find_driver)

    def find_driver(self, name: str) -> DriverSpec:
        if name not in self.specs:
            raise LookupError(f"driver {name!r} is broken")
        return self.specs[name]

    def add(self, name: str, asks_for_s: float, answer: Callable[[str], list[Found]], *listed: str) -> None:
        def ask(port: str) -> list[Found]:
            self.order.append((name, port))
            return answer(port)

        finder = Finder(
            f"{name}s",
            ports=lambda: [SerialPort(path, "an adapter") for path in listed],
            at_port=ask,
            asks_for_s=asks_for_s,
        )
        self.specs[name] = DriverSpec("stage", TheirSettings, lambda *_: None, find=finder)


@pytest.fixture
def asked(monkeypatch) -> Asked:
    return Asked(monkeypatch)


def nobody(port: str) -> list[Found]:
    return []


def test_quick_drivers_ask_first_and_nobody_asks_a_device_that_is_recognised(asked):
    asked.add("slow", 3.0, nobody, "/dev/a", "/dev/b")
    asked.add("middle", 2.0, lambda port: [Found("it", {"port": port})] if port == "/dev/a" else [])
    asked.add("quick", 1.0, nobody, "/dev/a")
    found = search(["/dev/b", "/dev/c"], [], ask=True)
    assert asked.order == [
        *[("quick", "/dev/a"), ("middle", "/dev/a")],
        *[("quick", "/dev/b"), ("middle", "/dev/b"), ("slow", "/dev/b")],
        *[("quick", "/dev/c"), ("middle", "/dev/c"), ("slow", "/dev/c")],
    ]
    assert lines(found) == [
        "no camera",
        "serial port /dev/a (an adapter): it",
        "serial port /dev/b (an adapter): no known device answers",
        "serial port /dev/c (named): no known device answers",
    ]


def test_a_driver_that_fails_keeps_no_other_from_its_device(asked):
    def broken(port: str) -> list[Found]:
        raise KeyError("gear")

    def shut(port: str) -> list[Found]:
        raise OSError("busy")

    asked.add("broken", 1.0, broken)
    asked.add("shut", 2.0, shut)
    failed = "driver 'broken' failed: KeyError: 'gear'; cannot be opened: busy"
    assert f"serial port /dev/a (named): {failed}" in lines(search(["/dev/a"], [], ask=True))
    asked.add("good", 3.0, lambda port: [Found("it", {"port": port})])
    assert "serial port /dev/a (named): it" in lines(search(["/dev/a"], [], ask=True))


def test_a_driver_that_does_not_load_is_said_and_the_others_search(asked, monkeypatch):
    asked.add("good", 1.0, lambda port: [Found("it", {"port": port})], "/dev/a")
    monkeypatch.setattr(device_search, "driver_names", lambda: ["bad", "good"])
    said = lines(search([], [], ask=True))
    assert said[1:] == ["left out: driver 'bad' is broken", "serial port /dev/a (an adapter): it"]


def test_what_a_person_must_decide_is_named_by_the_settings_the_driver_has(asked):
    asked.add("good", 1.0, lambda port: [Found("it", {"port": port})], "/dev/a")
    written = rig_file(search([], [], ask=True))
    assert '[stage]\ndriver = "good"\nport = "/dev/a"\n# gear: how far the stage may turn' in written


def test_found_channels_and_output_lines_get_tables_of_their_own(finders, tmp_path):
    boxes = [Found(f"a box {number}", {"address": f"192.168.0.{number}:502"}) for number in (20, 21)]
    finders["modbus-channels"] = Finder("boxes", answering=lambda: boxes)
    finders["modbus-pulse"] = Finder("lines", answering=lambda: boxes[:1])
    path = tmp_path / "rig.toml"
    done = run_rig("devices", "-o", path)
    assert done.status == 0
    assert "channels 192.168.0.20:502: a box 20" in done.out
    table = tomllib.loads(path.read_text())
    assert table["channels"]["box_1"] == {"driver": "modbus-channels", "address": "192.168.0.21:502"}
    assert table["triggers"]["line_0"]["driver"] == "modbus-pulse"
    assert "# rate_hz, signals: what is wired to the inputs" in path.read_text()
    with pytest.raises(ConfigurationError) as missing:
        read_rig(path)
    assert "channels.box_0.signals: is missing; add it" in missing.value.mistakes
