"""On every kind of line, the guard of a load frame reaches and holds the machine without the driver."""

from collections.abc import Iterator
from contextlib import ExitStack, closing
from dataclasses import dataclass, replace

import pytest

from drivers.errors import DeviceError, DeviceFault, DeviceTimeout
from drivers.lines.stop_deadline import StopTimes
from drivers.load_frames.modbus.guard import ModbusGuard
from drivers.load_frames.modbus.load_frame import ModbusLoadFrame, open_frame
from simulators.load_frame.modbus import LoadFrameRtuServer, LoadFrameServer
from simulators.wire.ports import LOCALHOST
from tests.drivers.load_frames.modbus.watched_port import settings


@dataclass(frozen=True)
class Guarded:
    """A guard and the driver of the same machine; it tells whether requests pass through the guard."""

    guard: ModbusGuard
    frame: ModbusLoadFrame
    relayed: bool


@pytest.fixture(params=["tcp 3", "tcp 2", "tcp 1", "rtu", "rtu over tcp"])
def guarded(request, device, context) -> Iterator[Guarded]:
    line, _, connections = request.param.partition(" ")
    changes = {"connections": int(connections)} if line == "tcp" else {}
    server = {
        "rtu": lambda: LoadFrameRtuServer(device),
        "rtu over tcp": lambda: LoadFrameRtuServer(device, LOCALHOST),
    }.get(request.param, lambda: LoadFrameServer(device))()
    address = f"rtu://{server.address}" if request.param == "rtu over tcp" else server.address
    chosen = settings(address, **changes)
    with ExitStack() as opened:
        opened.callback(server.close)
        guard = opened.enter_context(closing(ModbusGuard(chosen, context)))
        known = replace(context, guarded=True, relay=guard.relay)
        yield Guarded(guard, opened.enter_context(closing(open_frame(chosen, known))), bool(guard.relay))


def test_who_owns_the_only_line_passes_it_on(guarded, request):
    line = request.node.callspec.params["guarded"]
    assert guarded.relayed == (line not in ("tcp 3", "tcp 2"))


def test_the_guard_holds_a_motion_that_the_driver_began(guarded, device, clock):
    guarded.frame.go_to_displacement(1.0, 0.1)
    clock.sleep(1.0)
    assert guarded.frame.read().moving
    guarded.guard.check()
    guarded.guard.stop()
    assert (device.read().moving, device.read().holding) == (False, True)
    guarded.guard.stop()


def test_after_the_guards_hold_the_driver_begins_no_motion(guarded, device):
    guarded.frame.go_to_displacement(1.0, 0.1)
    guarded.guard.stop()
    with pytest.raises(DeviceError):
        guarded.frame.go_to_displacement(2.0, 0.1)
    assert device.read().holding


def test_a_motion_command_that_was_on_its_way_at_the_guards_hold_is_not_executed(port, device, context):
    """The number of the guard's hold is newer than every number of the run."""
    chosen = settings(port.address)
    with closing(ModbusGuard(chosen, context)) as guard, closing(open_frame(chosen, context)) as frame:
        late: list[bytes] = []

        def keep(request: bytes, answer):
            if request[0] == 16 and len(request) > 20 and not late:
                late.append(request)
                guard.stop()
                return request[:5]
            return answer()

        port.tamper = keep
        with pytest.raises(DeviceFault, match="another program"):
            frame.go_to_displacement(1.0, 0.1)
        port.answer(1, late[0])
        assert device.read().holding


def test_once_the_guard_is_gone_the_driver_holds_on_its_own_line(guarded, device, clock):
    guarded.frame.go_to_displacement(1.0, 0.1)
    clock.sleep(1.0)
    guarded.guard.close()
    guarded.frame.hold()
    assert device.read().holding


def test_a_hold_of_the_guard_that_is_not_confirmed_calls_for_the_emergency_stop(port, context):
    with closing(ModbusGuard(settings(port.address), context, StopTimes(deadline_s=0.2))) as guard:
        port.tamper = lambda request, answer: None
        with pytest.raises(DeviceTimeout, match="press the emergency stop"):
            guard.stop()


def test_a_machine_that_does_not_answer_the_guard_is_told_before_the_run(port, context):
    port.tamper = lambda request, answer: None
    with pytest.raises(DeviceTimeout, match="reach the machine for the guardian"):
        ModbusGuard(settings(port.address, reply_timeout_s=0.1), context)


def test_with_two_connections_and_a_guardian_the_driver_opens_one(device, context):
    with closing(LoadFrameServer(device)) as server:
        chosen = settings(server.address, connections=2)
        with (
            closing(ModbusGuard(chosen, context)),
            closing(open_frame(chosen, replace(context, guarded=True))),
        ):
            assert len(server._port._server._talks) == 2
