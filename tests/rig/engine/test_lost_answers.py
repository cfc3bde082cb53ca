"""With the default settings of every driver, a call succeeds within its deadline if one answer is lost."""

from collections.abc import Iterator
from contextlib import closing, nullcontext
from typing import Any

import pytest

from drivers.clock import SystemClock
from drivers.errors import DeviceError
from drivers.interfaces import OpenContext
from drivers.registry import find_driver
from rig.devices import open_rig
from rig.engine.calls import Calls, Deadline
from rig.rigfile import CALL_TIMEOUT_S, read_rig
from simulators import VirtualRig
from simulators.rig.virtual_rig import VirtualRigSettings
from tests.opened_rigs import opened_rigs

FRAME = {"load_max_n": 14000.0, "displacement_max_mm": 6.0}
STAGE = {"angle_min_deg": -5.0, "angle_max_deg": 365.0}
LINES = {
    "zaber": ("zaber-ascii", "stage", {"port": "@stage"} | STAGE),
    "zaber on TCP": ("zaber-ascii", "stage", {"port": "@stage_tcp"} | STAGE),
    "ESP301": ("newport-esp301", "newport", {"port": "@newport"} | STAGE),
    "Modbus TCP": ("modbus-frame", "load_frame", {"address": "@load_frame"} | FRAME),
    "Modbus RTU": ("modbus-frame", "load_frame", {"address": "@load_frame_rtu"} | FRAME),
    "RTU over TCP": ("modbus-frame", "load_frame", {"address": "@load_frame_rtu_tcp"} | FRAME),
}
FIRST = ("zaber", "ESP301", "Modbus TCP")
"""Each driver, which waits in the same way on its other lines."""
LINE = pytest.mark.parametrize(
    "line", [pytest.param(line, marks=[] if line in FIRST else pytest.mark.extended) for line in LINES]
)


@pytest.fixture
def virtual() -> Iterator[VirtualRig]:
    with closing(VirtualRig(VirtualRigSettings(real_time=True))) as made:
        yield made


def opened(virtual: VirtualRig, line: str) -> Any:
    driver, _, settings = LINES[line]
    spec = find_driver(driver)
    context = OpenContext(line, virtual.clock, virtual, call_timeout_s=CALL_TIMEOUT_S)
    return spec.open(spec.settings.model_validate(settings), context)


@pytest.mark.realtime
@LINE
@pytest.mark.parametrize(
    "fault",
    [
        "lose-request:1",
        "delay:0.5:1",
        pytest.param("drop:1", marks=pytest.mark.long),
        pytest.param("delay:0.3:1", marks=pytest.mark.long),
    ],
)
def test_reading_survives_one_lost_answer_within_its_deadline(virtual, line, fault):
    with closing(opened(virtual, line)) as device:
        calls = Calls(SystemClock(), lambda: None)
        virtual.faults.switch_on(f"{LINES[line][1]}.{fault}")
        before_s = SystemClock().now_s()
        assert calls.do(line, "read", device.read, Deadline(CALL_TIMEOUT_S)).moving is False
        print(f"{line}, {fault}: {SystemClock().now_s() - before_s:.2f} s")
        calls.close()


BUSY = """
[rig]
name = "busy"
[simulation]
driver = "virtual-rig"
patience_s = {patience_s}
[operator]
driver = "simulated-operator"
[load_frame]
driver = "modbus-frame"
address = "@load_frame"
load_max_n = 14000.0
displacement_max_mm = 6.0
[cameras.front]
driver = "simulated-camera"
[interlocks.door]
driver = "modbus-input"
address = "@interlocks"
number = 2
allowed_min = 1
"""


@pytest.mark.parametrize("device", ["load_frame", "interlock"])
def test_a_busy_computer_does_not_make_a_simulated_device_silent(device, tmp_path):
    """Simulated devices share the computer with other programs; simulated time stands still meanwhile."""
    for patience_s in (20.0, 0.0):
        path = tmp_path / "rig.toml"
        path.write_text(BUSY.format(patience_s=patience_s))
        with opened_rigs() as rigs, open_rig(read_rig(path)) as rig:
            read = rig.load_frame.read if device == "load_frame" else rig.interlocks["door"].device.read
            rigs[0].faults.switch_on(f"{device}.delay:0.8:1")
            with nullcontext() if patience_s else pytest.raises(DeviceError, match="an answer within"):
                read()


@pytest.mark.realtime
@LINE
def test_driver_reports_silence_itself_before_its_call_is_given_up(virtual, line):
    """Its message says more than that the call hangs."""
    with closing(opened(virtual, line)) as device:
        calls = Calls(SystemClock(), lambda: None)
        virtual.faults.switch_on(f"{LINES[line][1]}.lose-request")
        before_s = SystemClock().now_s()
        with pytest.raises(DeviceError) as error:
            calls.do(line, "read", device.read, Deadline(CALL_TIMEOUT_S))
        assert "the call hangs" not in str(error.value)
        assert "an answer within" in str(error.value)
        print(f"{line}: {SystemClock().now_s() - before_s:.2f} s: {error.value}")
        virtual.faults.clear()
        calls.close()
