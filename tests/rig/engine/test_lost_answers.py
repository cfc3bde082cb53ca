"""One lost answer is survived within the deadline of a call, with the defaults of every driver."""

from collections.abc import Iterator
from contextlib import closing
from typing import Any

import pytest

from drivers.clock import SystemClock
from drivers.errors import DeviceError
from drivers.interfaces import OpenContext
from drivers.registry import find_driver
from rig.engine.calls import Calls, Deadline
from rig.rigfile import CALL_TIMEOUT_S
from simulators import VirtualRig
from simulators.rig.virtual_rig import VirtualRigSettings

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


@pytest.fixture
def virtual() -> Iterator[VirtualRig]:
    with closing(VirtualRig(VirtualRigSettings(real_time=True))) as made:
        yield made


def opened(virtual: VirtualRig, line: str) -> Any:
    driver, _, settings = LINES[line]
    spec = find_driver(driver)
    context = OpenContext(line, virtual.clock, virtual, call_timeout_s=CALL_TIMEOUT_S)
    return spec.open(spec.settings.model_validate(settings), context)


@pytest.mark.parametrize("line", LINES)
@pytest.mark.parametrize("fault", ["drop:1", "lose-request:1", "delay:0.3:1", "delay:0.5:1"])
def test_reading_survives_one_lost_answer_within_its_deadline(virtual, line, fault):
    with closing(opened(virtual, line)) as device:
        calls = Calls(SystemClock(), lambda: None)
        virtual.faults.switch_on(f"{LINES[line][1]}.{fault}")
        before_s = SystemClock().now_s()
        assert calls.do(line, "read", device.read, Deadline(CALL_TIMEOUT_S)).moving is False
        print(f"{line}, {fault}: {SystemClock().now_s() - before_s:.2f} s")
        calls.close()


@pytest.mark.parametrize("line", LINES)
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
