import dataclasses
import math
import struct
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

import drivers.modbus_commands
import drivers.modbus_frame
import drivers.modbus_link
from drivers.clock import VirtualClock
from drivers.errors import ConfigurationError, DeviceFault, DeviceTimeout, LinkLost
from drivers.interfaces import OpenContext
from drivers.modbus_frame import ModbusFrame, open_frame
from drivers.modbus_frame_settings import ModbusFrameSettings
from drivers.registry import find_driver
from drivers.settings import validate
from simulators.frame_device import FrameDevice
from simulators.frame_layout import LAYOUTS
from simulators.frame_wire import FrameServer

STIFFNESS_N_MM = 5000.0
COMMAND_ADDRESS = 0
HEARTBEAT_ADDRESS = 66
Answer = Callable[[], bytes | None]


class Spring:
    """A linear load string."""

    broken_cell = False

    def stretch_to(self, displacement_mm: float) -> float:
        return math.nan if self.broken_cell else STIFFNESS_N_MM * displacement_mm


class Port(FrameServer):
    """A load frame whose every message a test may see, change, lose or delay."""

    def __init__(self, device: FrameDevice) -> None:
        self.commands: list[tuple[int, int]] = []
        self.tamper: Callable[[bytes, Answer], bytes | None] = lambda request, answer: answer()
        super().__init__(device)

    def answer(self, unit: int, request: bytes) -> bytes | None:
        if is_command(request):
            self.commands.append((int.from_bytes(request[6:8], "big"), int.from_bytes(request[-2:], "big")))
        return self.tamper(request, lambda: super(Port, self).answer(unit, request))


def is_command(request: bytes) -> bool:
    return request[0] == 16 and struct.unpack(">H", request[1:3])[0] == COMMAND_ADDRESS


def is_state(request: bytes) -> bool:
    return request[:3] == b"\x04\x00\x00"


def settings(address: str, **changes: object) -> ModbusFrameSettings:
    values = {"address": address, "load_max_n": 12000.0, "displacement_max_mm": 5.3, "reply_timeout_s": 0.3}
    return ModbusFrameSettings.model_validate(values | changes)


@pytest.fixture
def spring() -> Spring:
    return Spring()


@pytest.fixture
def device(clock: VirtualClock, spring: Spring) -> FrameDevice:
    return FrameDevice(clock, spring)


@pytest.fixture
def port(device: FrameDevice) -> Iterator[Port]:
    server = Port(device)
    yield server
    server.close()
    server.close()


@pytest.fixture
def frame(port: Port, context: OpenContext) -> Iterator[ModbusFrame]:
    opened = open_frame(settings(port.address), context)
    yield opened
    opened.close()
    opened.close()


def wait(frame: ModbusFrame, clock: VirtualClock) -> float:
    """Wait for standstill in simulated time and return the seconds it took."""
    start_s = clock.now_s()
    while frame.read().moving:
        clock.sleep(0.1)
        assert clock.now_s() - start_s < 3600
    return clock.now_s() - start_s


def test_goes_to_a_load_along_the_ramp(frame, device, clock):
    frame.go_to_load(2000.0, 200.0)
    assert wait(frame, clock) == pytest.approx(10.0, abs=0.2)
    state = frame.read()
    assert state.at_target
    assert state.faults == ()
    assert state.load_n == pytest.approx(2000.0, abs=1.0)
    assert state.displacement_mm == pytest.approx(2000.0 / STIFFNESS_N_MM, abs=1e-3)
    assert device.load_n() == pytest.approx(state.load_n, rel=1e-6)


def test_goes_to_a_displacement_at_its_speed_and_back(frame, clock):
    frame.go_to_displacement(0.3, 0.05)
    assert wait(frame, clock) == pytest.approx(6.0, abs=0.2)
    assert frame.read().displacement_mm == pytest.approx(0.3, abs=1e-6)
    frame.go_to_displacement(0.1, 0.05)
    wait(frame, clock)
    assert frame.read().load_n == pytest.approx(0.1 * STIFFNESS_N_MM, rel=1e-5)


def test_tare_makes_the_present_state_the_zero(frame, clock):
    frame.go_to_displacement(0.2, 0.1)
    wait(frame, clock)
    frame.tare()
    state = frame.read()
    assert (state.load_n, state.displacement_mm) == (0.0, 0.0)
    frame.go_to_load(500.0, 100.0)
    wait(frame, clock)
    assert frame.read().displacement_mm == pytest.approx(0.1, abs=1e-3)


def test_tells_who_it_is(frame):
    assert (frame.info.model, frame.info.serial, frame.info.firmware) == ("tensile frame", "220001", "1.4")


def test_limits_are_in_the_machine(frame, device):
    assert frame.limits.displacement_max_mm == 5.3
    assert device.limits.displacement_max_mm == pytest.approx(5.3, rel=1e-7)
    assert dataclasses.astuple(device.limits) == pytest.approx(dataclasses.astuple(frame.limits), rel=1e-7)


def test_limits_wider_than_the_machine_are_refused(port, context):
    with pytest.raises(DeviceFault, match=r"write holding registers 32 to 43: .*illegal data value"):
        open_frame(settings(port.address, load_max_n=60_000.0), context)


def test_limits_that_read_back_differently_are_refused(port, context):
    def forget(request: bytes, answer: Answer) -> bytes | None:
        if request[:3] == b"\x10\x00\x20":
            return request[:5]
        return answer()

    port.tamper = forget
    with pytest.raises(DeviceFault, match=r"set limits: expected .*load_max 12000.* on reading back"):
        open_frame(settings(port.address), context)


def test_limits_that_the_machine_has_already_are_not_written_again(frame, port, context):
    """They may be kept in a memory that wears with writing."""
    written: list[bytes] = []

    def watch(request: bytes, answer: Answer) -> bytes | None:
        written.extend([request] if request[0] == 16 else [])
        return answer()

    port.tamper = watch
    open_frame(settings(port.address), context).close()
    assert written == []
    open_frame(settings(port.address, load_max_n=11_000.0), context).close()
    assert [request[:3] for request in written] == [b"\x10\x00\x20"]


@pytest.mark.parametrize("start", [b"\x04\x00\x00", b"\x10\x00\x42"], ids=["state", "heartbeat"])
def test_a_machine_that_takes_one_connection_is_held_over_it(port, device, context, start):
    frame = open_frame(settings(port.address, connections=1, reply_timeout_s=30.0), context)
    frame.go_to_displacement(1.0, 0.1)
    asked = threading.Event()

    def swallow_first(request: bytes, answer: Answer) -> bytes | None:
        if request[:3] == start and not asked.is_set():
            asked.set()
            return None
        return answer()

    port.tamper = swallow_first
    with ThreadPoolExecutor(1) as pool:
        reading = pool.submit(frame.read)
        assert asked.wait(30.0)
        frame.hold()
        assert device.read().holding
        # the state is asked for again behind the hold, and the heartbeat is needed no more
        assert reading.result(30.0).holding is (start[0] == 4)
    frame.close()


def test_settings_that_somebody_else_has_changed_are_noticed_before_motion(frame, device, port):
    device.set_watchdog(0.0)
    with pytest.raises(DeviceFault, match="expected the watchdog this program has set, got another setting"):
        frame.go_to_displacement(1.0, 0.1)
    assert port.commands == []


def test_a_watchdog_that_the_machine_does_not_take_is_refused(port, context):
    port.tamper = lambda request, answer: request[:5] if request[:3] == b"\x10\x00\x40" else answer()
    with pytest.raises(DeviceFault, match=r"set watchdog: expected timeout 2, got timeout 0 on reading back"):
        open_frame(settings(port.address), context)


@pytest.mark.parametrize(
    "go",
    [
        lambda frame: frame.go_to_load(12000.1, 100.0),
        lambda frame: frame.go_to_load(-100.1, 100.0),
        lambda frame: frame.go_to_load(math.nan, 100.0),
        lambda frame: frame.go_to_load(100.0, 0.0),
        lambda frame: frame.go_to_load(100.0, 1000.1),
        lambda frame: frame.go_to_displacement(5.31, 0.1),
        lambda frame: frame.go_to_displacement(-1.01, 0.1),
        lambda frame: frame.go_to_displacement(math.inf, 0.1),
        lambda frame: frame.go_to_displacement(1.0, -0.1),
        lambda frame: frame.go_to_displacement(1.0, math.nan),
    ],
)
def test_what_is_beyond_the_limits_is_refused_before_anything_is_sent(frame, port, go):
    with pytest.raises(DeviceFault, match="correct the protocol"):
        go(frame)
    assert port.commands == []


def test_the_very_limit_is_allowed(frame, clock):
    frame.go_to_displacement(2.4, 1.0)
    wait(frame, clock)
    assert frame.read().load_n == pytest.approx(12000.0, rel=1e-6)
    assert frame.read().faults == ()


def test_the_machine_enforces_its_limits_itself(frame, clock, device):
    frame.go_to_displacement(5.0, 1.0)
    wait(frame, clock)
    state = frame.read()
    assert state.faults == ("load limit",)
    assert state.holding
    assert device.load_n() == pytest.approx(12000.0, abs=1.0 * 0.02 * STIFFNESS_N_MM + 1.0)
    frame.go_to_displacement(0.0, 1.0)
    wait(frame, clock)
    assert frame.read().faults == ()


def test_a_refusal_of_the_machine_is_told(frame, clock):
    frame.go_to_displacement(1.0, 0.1)
    with pytest.raises(DeviceFault, match="tare: expected acceptance, got the machine is not ready"):
        frame.tare()


def test_an_open_emergency_stop_is_a_fault_and_refuses_motion(frame, device):
    device.press_estop()
    assert "emergency stop" in frame.read().faults
    with pytest.raises(DeviceFault, match="emergency stop is open"):
        frame.go_to_displacement(1.0, 0.1)


def test_the_watchdog_holds_when_nobody_reads_while_moving(frame, device, clock):
    frame.go_to_displacement(5.0, 0.1)
    clock.sleep(10.0)
    state = frame.read()
    assert state.faults == ("watchdog",)
    assert state.holding
    # 2 s of silence at 0.1 mm/s, and one control period
    assert device.displacement_mm() == pytest.approx(0.2, abs=0.0021)
    frame.go_to_displacement(1.0, 0.1)
    assert frame.read().faults == ()


def test_reading_feeds_the_watchdog(frame, clock):
    frame.go_to_displacement(2.0, 0.1)
    for _ in range(15):
        clock.sleep(1.0)
        assert frame.read().moving
    assert frame.read().displacement_mm == pytest.approx(1.5, abs=0.0021)


def test_a_counter_that_stands_still_is_stale(frame, port, clock):
    frozen: list[bytes] = []

    def freeze(request: bytes, answer: Answer) -> bytes | None:
        reply = answer()
        if is_state(request) and reply is not None:
            frozen.append(reply)
            return frozen[0]
        return reply

    port.tamper = freeze
    frame.read()
    clock.sleep(1.0)
    with pytest.raises(DeviceFault, match="read: expected a new reading, got sample 0 again after 1 s"):
        frame.read()


def test_a_restarted_machine_is_not_trusted(frame, port, clock, spring):
    clock.sleep(10.0)
    frame.read()
    port.device.power_cycle()
    clock.sleep(1.0)
    with pytest.raises(DeviceFault, match="a restarted machine"):
        frame.read()
    with pytest.raises(DeviceFault, match="a restarted machine"):
        frame.go_to_displacement(1.0, 0.1)


def test_a_load_that_is_no_number_is_refused_but_the_machine_still_holds(frame, device, spring, clock):
    frame.go_to_displacement(1.0, 0.1)
    spring.broken_cell = True
    clock.sleep(0.1)
    with pytest.raises(DeviceFault, match="read: expected valid values, got load is no valid value"):
        frame.read()
    frame.hold()
    assert device.read().holding


def test_a_load_marked_invalid_is_refused(frame, port):
    def unmark(request: bytes, answer: Answer) -> bytes | None:
        reply = answer()
        if is_state(request) and reply is not None:
            status = int.from_bytes(reply[8:10], "big") & ~(1 << 7)
            return reply[:8] + status.to_bytes(2, "big") + reply[10:]
        return reply

    port.tamper = unmark
    with pytest.raises(DeviceFault, match="a load marked invalid"):
        frame.read()


def test_a_map_of_another_revision_is_refused(port, context):
    def renumber(request: bytes, answer: Answer) -> bytes | None:
        reply = answer()
        return reply[:2] + b"\x00\x02" + reply[4:] if is_state(request) and reply is not None else reply

    port.tamper = renumber
    with pytest.raises(DeviceFault, match="expected register map revision 1, got 2"):
        open_frame(settings(port.address), context)


def test_a_command_whose_answer_is_lost_is_proven_by_its_number_and_sent_once(frame, port, clock):
    def lose(request: bytes, answer: Answer) -> bytes | None:
        reply = answer()
        return None if is_command(request) else reply

    port.tamper = lose
    frame.go_to_displacement(0.3, 0.1)
    assert len(port.commands) == 1
    wait(frame, clock)
    assert frame.read().displacement_mm == pytest.approx(0.3, abs=1e-6)


def test_a_connection_that_ends_with_a_command_leaves_it_to_be_proven(frame, port, device):
    def cut(request: bytes, answer: Answer) -> bytes | None:
        reply = answer()
        if is_command(request):
            raise OSError("the cable was pulled")
        return reply

    port.tamper = cut
    frame.go_to_displacement(0.3, 0.1)
    assert len(port.commands) == 1
    assert device.read().moving


def test_a_command_that_never_arrived_is_sent_again_under_the_same_number(frame, port):
    lost = iter([True])
    port.tamper = lambda request, answer: None if is_command(request) and next(lost, False) else answer()
    frame.tare()
    assert len(port.commands) == 2
    assert port.commands[0][1] == port.commands[1][1]


def test_a_command_that_never_arrives_is_a_timeout(frame, port, device):
    port.tamper = lambda request, answer: None if is_command(request) else answer()
    with pytest.raises(DeviceTimeout, match="command 1 executed, got command 0 as the last one"):
        frame.go_to_displacement(0.3, 0.1)
    assert device.read().holding


def test_another_program_that_took_over_is_noticed(frame, port, clock, context):
    other = open_frame(settings(port.address), context)
    for _ in range(3):
        other.hold()
    other.close()
    with pytest.raises(DeviceTimeout, match="nothing else commands the machine"):
        frame.go_to_displacement(0.3, 0.1)
    frame.hold()
    frame.go_to_displacement(0.3, 0.1)
    wait(frame, clock)
    assert frame.read().at_target


def test_hold_stops_the_crosshead_at_once(frame, device, clock):
    frame.go_to_displacement(1.0, 0.1)
    clock.sleep(1.0)
    frame.hold()
    clock.sleep(100.0)
    assert device.displacement_mm() == pytest.approx(0.1, abs=0.0021)
    assert frame.read().holding


def test_hold_goes_out_while_another_request_waits_for_its_answer(port, device, clock, context):
    frame = open_frame(settings(port.address, reply_timeout_s=30.0), context)
    frame.go_to_displacement(1.0, 0.1)
    asked, release = threading.Event(), threading.Event()
    first = iter([True])

    def slow(request: bytes, answer: Answer) -> bytes | None:
        reply = answer()
        if is_state(request) and next(first, False):
            asked.set()
            assert release.wait(30.0)
        return reply

    port.tamper = slow
    with ThreadPoolExecutor(1) as pool:
        reading = pool.submit(frame.read)
        assert asked.wait(30.0)
        frame.hold()
        assert not reading.done()
        assert device.read().holding
        release.set()
        assert reading.result(30.0).moving
    frame.close()


def test_a_motion_command_overtaken_by_hold_is_not_executed(port, device, context):
    frame = open_frame(settings(port.address, reply_timeout_s=30.0), context)
    arrived, release = threading.Event(), threading.Event()
    first = iter([True])

    def slow(request: bytes, answer: Answer) -> bytes | None:
        if is_command(request) and next(first, False):
            arrived.set()
            assert release.wait(30.0)
        return answer()

    port.tamper = slow
    with ThreadPoolExecutor(1) as pool:
        moving = pool.submit(frame.go_to_displacement, 1.0, 0.1)
        assert arrived.wait(30.0)
        frame.hold()
        release.set()
        with pytest.raises(DeviceFault, match="expected no hold meanwhile"):
            moving.result(30.0)
    assert device.read().holding
    frame.close()


def test_hold_is_repeated_until_it_is_confirmed(frame, port, device):
    frame.go_to_displacement(1.0, 0.1)
    port.commands.clear()
    lost = iter([True, True])
    port.tamper = lambda request, answer: None if is_command(request) and next(lost, False) else answer()
    frame.hold()
    assert len(port.commands) == 3
    assert device.read().holding


@pytest.mark.parametrize(("on", "off"), [(1 << 1, 0), (0, 1 << 3)], ids=["moving", "not holding"])
def test_hold_lasts_until_the_crosshead_stands(frame, port, on, off):
    braking = iter([True, True])

    def brake(request: bytes, answer: Answer) -> bytes | None:
        reply = answer()
        if is_state(request) and reply is not None and next(braking, False):
            status = (int.from_bytes(reply[8:10], "big") | on) & ~off
            return reply[:8] + status.to_bytes(2, "big") + reply[10:]
        return reply

    port.tamper = brake
    frame.hold()
    assert next(braking, None) is None
    assert len(port.commands) == 3


def test_hold_goes_on_from_the_number_of_whoever_commanded_the_machine_meanwhile(frame, port):
    port.answer(1, struct.pack(">BHHBHffffH", 16, COMMAND_ADDRESS, 10, 20, 1, 0, 0, 0, 0, 20_000))
    frame.hold()
    assert [sequence for _, sequence in port.commands] == [20_000, 1, 20_001]


def test_a_hold_that_is_acknowledged_but_not_executed_is_repeated(frame, port, device):
    assert device.read().holding
    ignored = iter([True])

    def ignore(request: bytes, answer: Answer) -> bytes | None:
        return request[:5] if is_command(request) and next(ignored, False) else answer()

    port.tamper = ignore
    frame.hold()
    assert len(port.commands) == 2


def test_a_hold_that_is_never_confirmed_calls_for_the_emergency_stop(frame, port, monkeypatch):
    monkeypatch.setattr(drivers.modbus_commands, "HOLD_PATIENCE_S", 0.5)
    port.tamper = lambda request, answer: None
    with pytest.raises(DeviceTimeout, match=r"hold: expected a confirmed hold, .*press the emergency stop"):
        frame.hold()


def test_after_a_lost_link_motion_waits_for_a_hold(frame, port, clock):
    silent = iter([True] * 2)
    port.tamper = lambda request, answer: None if next(silent, False) else answer()
    with pytest.raises(DeviceTimeout):
        frame.read()
    frame.read()
    with pytest.raises(DeviceFault, match="a link that was lost"):
        frame.go_to_displacement(0.1, 0.1)
    frame.hold()
    frame.go_to_displacement(0.1, 0.1)
    wait(frame, clock)
    assert frame.read().at_target


def test_a_cable_pulled_and_replugged_between_two_reads_is_survived(frame, port):
    port.drop_clients()
    assert frame.read().holding
    port.drop_clients()
    frame.hold()


def test_a_server_that_is_gone_is_a_lost_link(frame, port, monkeypatch):
    monkeypatch.setattr(drivers.modbus_commands, "HOLD_PATIENCE_S", 0.1)
    port.close()
    with pytest.raises(LinkLost):
        frame.read()
    with pytest.raises(DeviceTimeout, match="press the emergency stop"):
        frame.hold()


def test_nobody_at_the_address_is_told(port, context):
    address = port.address
    port.close()
    with pytest.raises(LinkLost, match="check the cable, the address"):
        open_frame(settings(address), context)


def test_a_mute_machine_is_a_timeout(port, context):
    port.tamper = lambda request, answer: None
    with pytest.raises(DeviceTimeout, match=r"expected an answer within 0\.3 s"):
        open_frame(settings(port.address), context)


def test_another_unit_does_not_answer(port, context):
    with pytest.raises(DeviceTimeout, match=r"identify: .* expected an answer of unit 7, .*exception 11"):
        open_frame(settings(port.address, unit=7), context)


def test_an_answer_lost_behind_a_gateway_is_a_lost_answer(frame, port, device):
    """Exceptions 10 and 11 are the gateway's own: the machine may have done what it was told."""
    lost = iter([True])

    def lose(request: bytes, answer: Answer) -> bytes | None:
        reply = answer()
        return bytes([0x90, 11]) if is_command(request) and next(lost, False) else reply

    port.tamper = lose
    frame.go_to_displacement(0.3, 0.1)
    assert device.read().moving
    assert len(port.commands) == 1
    silent = iter([True])
    port.tamper = lambda request, answer: b"\x84\x0b" if next(silent, False) else answer()
    assert frame.read().moving


def test_mistakes_in_the_rig_file_are_reported_together():
    spec = find_driver("modbus-frame")
    table = {"address": "nowhere", "load_max_n": -1.0, "colour": "red"}
    with pytest.raises(ConfigurationError) as caught:
        validate(spec.settings, table, "rig.toml")
    assert len(caught.value.mistakes) == 4


def test_mistakes_in_the_register_map_are_reported_with_those_of_the_rig_file(tmp_path):
    path = tmp_path / "map.toml"
    path.write_text('vendor = 1\ncolour = "red"')
    table = {"address": "host:502", "load_max_n": -1.0, "displacement_max_mm": 1.0, "map": str(path)}
    with pytest.raises(ConfigurationError) as caught:
        validate(find_driver("modbus-frame").settings, table, "rig.toml")
    map_mistake, limit_mistake = sorted(caught.value.mistakes, key=lambda each: each.startswith("load_max_n"))
    assert map_mistake.startswith(f"map: {path}: ")
    assert all(part in map_mistake for part in ("vendor", "colour: unknown key", "blocks: is missing"))
    assert limit_mistake.startswith("load_max_n")


def test_a_simulated_name_without_a_simulated_rig_is_told(context):
    with pytest.raises(LinkLost, match="no simulated rig"):
        open_frame(settings("@load_frame"), context)


def test_set_points_that_are_not_taken_are_not_followed_by_a_command(device, context):
    commands: list[bytes] = []

    class Forgetful(FrameServer):
        def answer(self, unit: int, request: bytes) -> bytes | None:
            if request[:3] == b"\x10\x00\x00":
                return request[:5]
            commands.extend([request] if request[:3] == b"\x10\x00\x10" else [])
            return super().answer(unit, request)

    server = Forgetful(device, layout=LAYOUTS["separate-words"])
    frame = open_frame(settings(server.address, map="separate-words"), context)
    with pytest.raises(DeviceFault, match=r"write set points: expected displacement 1, speed 0\.1, got"):
        frame.go_to_displacement(1.0, 0.1)
    assert commands == []
    frame.close()
    server.close()


def test_silence_to_the_settings_before_a_motion_is_a_lost_link_too(frame, port):
    silent = iter([True] * 2)

    def lose_limits(request: bytes, answer: Answer) -> bytes | None:
        return None if request[:3] == b"\x03\x00\x20" and next(silent, False) else answer()

    port.tamper = lose_limits
    with pytest.raises(DeviceTimeout):
        frame.go_to_displacement(0.1, 0.1)
    with pytest.raises(DeviceFault, match="a link that was lost"):
        frame.go_to_displacement(0.1, 0.1)
    frame.hold()
    frame.go_to_displacement(0.1, 0.1)


def test_after_a_command_that_was_not_confirmed_motion_waits_for_a_hold(frame, port, device):
    """It may still be under way, and come when nobody expects it."""
    lost: list[bytes] = []

    def delay(request: bytes, answer: Answer) -> bytes | None:
        if is_command(request) and len(lost) < 2:
            lost.append(request)
            return request[:5]
        return answer()

    port.tamper = delay
    with pytest.raises(DeviceTimeout, match="expected command 1 executed"):
        frame.go_to_displacement(0.1, 0.1)
    with pytest.raises(DeviceFault, match="a command that was not confirmed"):
        frame.go_to_displacement(0.2, 0.1)
    frame.hold()
    port.answer(1, lost[0])
    assert device.read().holding


def test_no_motion_begins_until_a_hold_was_confirmed(port, device, context, monkeypatch):
    monkeypatch.setattr(drivers.modbus_commands, "HOLD_PATIENCE_S", 0.1)
    frame = open_frame(settings(port.address, reply_timeout_s=0.1), context)
    port.tamper = lambda request, answer: request[:5] if is_command(request) else answer()
    with pytest.raises(DeviceTimeout, match="press the emergency stop"):
        frame.hold()
    port.tamper = lambda request, answer: answer()
    with pytest.raises(DeviceFault, match="a hold that was not confirmed"):
        frame.go_to_displacement(0.1, 0.1)
    frame.hold()
    frame.go_to_displacement(0.1, 0.1)
    assert device.read().moving
    frame.close()


def test_a_hold_is_repeated_before_a_long_answer_would_have_come(port, device, context):
    """With a minute's patience for an answer there would be one try, and the engine would give up first."""
    frame = open_frame(settings(port.address, reply_timeout_s=60.0), context)
    frame.go_to_displacement(1.0, 0.1)
    lost = iter([True])
    port.tamper = lambda request, answer: None if is_command(request) and next(lost, False) else answer()
    with ThreadPoolExecutor(1) as pool:
        pool.submit(frame.hold).result(30.0)
    assert device.read().holding
    frame.close()


def test_another_machine_at_the_address_is_noticed_after_a_lost_connection(frame, port, clock):
    def another(request: bytes, answer: Answer) -> bytes | None:
        reply = answer()
        # input registers 32 and 33, the serial number
        return reply[:4] + b"\x00\x07" + reply[6:] if request[:3] == b"\x04\x00\x20" and reply else reply

    port.tamper = another
    assert frame.read().holding
    port.drop_clients()
    with pytest.raises(LinkLost, match=r"expected the machine with \[3, 23393, 260\] in its identity"):
        frame.read()
    with pytest.raises(DeviceFault, match="a link that was lost"):
        frame.go_to_displacement(0.1, 0.1)
    port.tamper = lambda request, answer: answer()
    frame.hold()
    frame.go_to_displacement(0.1, 0.1)


@pytest.mark.parametrize(("connections", "after_a_pause"), [(2, 2), (1, 1)])
def test_the_connection_for_hold_is_kept_in_use(port, clock, context, connections, after_a_pause):
    """Switches and machines forget what is idle for hours, and a hold would be the first to find out."""
    frame = open_frame(settings(port.address, connections=connections), context)
    asked: list[bytes] = []

    def count(request: bytes, answer: Answer) -> bytes | None:
        asked.extend([request] if is_state(request) else [])
        return answer()

    port.tamper = count
    for pause_s, requests in ((0.1, 1), (10.5, after_a_pause), (0.1, 1)):
        clock.sleep(pause_s)
        asked.clear()
        frame.read()
        assert len(asked) == requests
    frame.close()


def test_without_a_way_for_hold_nothing_moves(frame, port, clock):
    clock.sleep(10.5)
    asked = iter([True])
    port.tamper = lambda request, answer: answer() if not is_state(request) or next(asked, False) else None
    with pytest.raises(DeviceTimeout, match="prove the way for hold"):
        frame.read()
    port.tamper = lambda request, answer: answer()
    with pytest.raises(DeviceFault, match="a link that was lost"):
        frame.go_to_displacement(0.1, 0.1)


def test_a_hold_does_not_wait_for_its_own_proof(port, device, clock, context, monkeypatch):
    monkeypatch.setattr(drivers.modbus_link, "URGENT_TIMEOUT_S", 60.0)
    frame = open_frame(settings(port.address, reply_timeout_s=60.0, watchdog_s=60.0), context)
    frame.go_to_displacement(1.0, 0.01)
    clock.sleep(10.5)
    states = iter([False, True])
    asked = threading.Event()

    def swallow_proof(request: bytes, answer: Answer) -> bytes | None:
        if is_state(request) and next(states, False):
            asked.set()
            return None
        return answer()

    port.tamper = swallow_proof
    with ThreadPoolExecutor(2) as pool:
        reading = pool.submit(frame.read)
        assert asked.wait(30.0)
        assert device.read().moving
        # long before the proof is overdue
        pool.submit(frame.hold).result(30.0)
        assert device.read().holding
        reading.result(30.0)
    frame.close()


@pytest.mark.parametrize(("connections", "remedy"), [(2, "set connections = 1"), (1, "check that the")])
def test_a_hold_that_would_not_be_answered_is_told_on_opening(port, context, connections, remedy):
    identified = iter([False])

    def one_only(request: bytes, answer: Answer) -> bytes | None:
        if request[:3] == b"\x04\x00\x20" and next(identified, True):
            return None
        return answer()

    port.tamper = one_only
    with pytest.raises(DeviceTimeout, match=rf"prove the way for hold: .*; {remedy}"):
        open_frame(settings(port.address, reply_timeout_s=0.1, connections=connections), context)


def test_two_machines_at_one_address_are_told(port, context):
    """A hold would stop the other one."""
    serials = iter([b"\x00\x01", b"\x00\x02"])

    def either(request: bytes, answer: Answer) -> bytes | None:
        reply = answer()
        if request[:3] == b"\x04\x00\x20" and reply is not None:
            return reply[:4] + next(serials) + reply[6:]
        return reply

    port.tamper = either
    with pytest.raises(DeviceFault, match="check that one machine only has this address"):
        open_frame(settings(port.address), context)


def test_what_else_stands_among_the_settings_is_left_alone(port, context, tmp_path):
    """A map may declare what it does not know, and a zero may mean anything there."""
    generic = (Path(drivers.modbus_frame.__file__).parent / "maps" / "generic.toml").read_text()
    after = 'registers.load_rate_max = { address = 42, type = "f32", unit = "N/s" }\n'
    assert after in generic
    path = tmp_path / "map.toml"
    path.write_text(generic.replace(after, after + 'registers.unknown = { address = 44, type = "u16" }\n'))
    unknown = b"\x12\x34"

    def one_more(request: bytes, answer: Answer) -> bytes | None:
        nonlocal unknown
        if request == bytes.fromhex("03 0020 000D"):
            reply = FrameServer.answer(port, 1, bytes.fromhex("03 0020 000C"))
            return b"\x03\x1a" + reply[2:] + unknown
        if request[:6] == bytes.fromhex("10 0020 000D 1A"):
            unknown = request[-2:]
            FrameServer.answer(port, 1, bytes.fromhex("10 0020 000C 18") + request[6:-2])
            return request[:5]
        return answer()

    port.tamper = one_more
    frame = open_frame(settings(port.address, map=str(path)), context)
    assert port.device.limits.load_max_n == 12000.0
    assert unknown == b"\x12\x34"
    frame.go_to_displacement(0.1, 0.1)
    frame.close()


def test_set_points_that_a_motion_does_not_need_stay_as_they_are(device, context):
    """A machine that stands at its load would follow a set point of 0 N before the command comes."""
    server = FrameServer(device, layout=LAYOUTS["separate-words"])
    frame = open_frame(settings(server.address, map="separate-words"), context)
    frame.go_to_load(1500.0, 100.0)
    frame.go_to_displacement(0.25, 0.125)
    # displacement, speed, load, load rate
    reply = server.answer(1, bytes.fromhex("03 0000 0008"))
    assert struct.unpack(">ffff", reply[2:]) == (0.25, 0.125, 1500.0, 100.0)
    frame.close()
    server.close()


def test_the_time_of_a_reading_is_that_of_its_answer(frame, port, clock):
    def slow_heartbeat(request: bytes, answer: Answer) -> bytes | None:
        if request[:3] == b"\x10\x00\x42":
            clock.sleep(0.4)
        return answer()

    port.tamper = slow_heartbeat
    asked_s = clock.now_s()
    assert frame.read().time_s == asked_s


def test_the_watchdog_is_fed_before_a_motion(frame, port):
    """Some count all the time: after a long pause such a machine would stop at once."""
    seen: list[str] = []

    def watch(request: bytes, answer: Answer) -> bytes | None:
        if request[:3] == b"\x10\x00\x42":
            seen.append("heartbeat")
        if is_command(request):
            seen.append("command")
        return answer()

    port.tamper = watch
    frame.go_to_displacement(0.1, 0.1)
    assert seen == ["heartbeat", "command"]


def test_a_link_says_what_it_was_used_for(frame, port):
    port.tamper = lambda request, answer: b"\x90\x04" if request[0] == 16 else answer()
    with pytest.raises(DeviceFault, match=r"feed the watchdog: write holding registers 66 to 66: .*failure"):
        frame.read()


def test_two_connections_mean_nothing_on_a_line():
    limits = {"load_max_n": 1000.0, "displacement_max_mm": 5.0}
    for address in ("/dev/ttyUSB0", "rtu://192.168.0.9:4001"):
        with pytest.raises(ValueError, match="connections belong to Modbus TCP"):
            ModbusFrameSettings(address=address, connections=2, **limits)


def test_a_restart_that_a_narrow_counter_does_not_tell_shows_in_the_commands(device, context, clock):
    server = FrameServer(device, layout=LAYOUTS["separate-words"])
    frame = open_frame(settings(server.address, map="separate-words"), context)
    frame.tare()
    device.power_cycle()
    # nobody reads for so long that 16 bits may have gone round
    clock.sleep(60.0)
    with pytest.raises(DeviceFault, match=r"a restarted machine \(command 0 executed after 1\)"):
        frame.read()
    frame.close()
    server.close()


def test_a_status_apart_is_read_before_the_readings(device, context):
    """Or "at target" might be newer than a load from before the target."""
    asked: list[int] = []

    class Watched(FrameServer):
        def answer(self, unit: int, request: bytes) -> bytes | None:
            asked.extend([request[2]] if request[0] == 4 else [])
            return super().answer(unit, request)

    server = Watched(device, layout=LAYOUTS["separate-words"])
    frame = open_frame(settings(server.address, map="separate-words"), context)
    asked.clear()
    frame.read()
    assert asked == [16, 0]
    frame.close()
    server.close()
