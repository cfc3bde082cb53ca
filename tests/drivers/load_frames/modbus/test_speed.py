"""A change of speed is read back, compared with the travel, and never outruns a hold of driver or guard."""

import struct
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from pathlib import Path
from threading import Event

import pytest

from drivers.errors import DeviceError, DeviceFault
from drivers.load_frames.modbus.guard import ModbusGuard
from drivers.load_frames.modbus.load_frame import open_frame
from drivers.load_frames.modbus.registers import map as register_maps
from simulators.load_frame.device import SpeedFault
from simulators.load_frame.layout import LAYOUTS
from simulators.load_frame.modbus import LoadFrameServer
from tests.drivers.load_frames.modbus.test_guard import guarded  # noqa: F401
from tests.drivers.load_frames.modbus.watched_port import Answer, is_command, is_state, settings

MAPS = Path(register_maps.__file__).parents[1] / "maps"
SPEED = 5
SET_SPEED_BYTES = slice(2 + 2 * 18, 2 + 2 * 20)


def is_change(request: bytes) -> bool:
    return is_command(request) and int.from_bytes(request[6:8], "big") == SPEED


def test_a_speed_that_is_beyond_the_limits_is_refused_before_anything_is_sent(frame, port):
    frame.go_to_displacement(1.0, 0.1)
    port.commands.clear()
    with pytest.raises(DeviceFault, match=r"expected a rate above 0 up to 1 mm/s, got 1\.5 mm/s"):
        frame.change_speed(1.5)
    assert port.commands == []


def test_the_machine_reports_the_speed_of_its_motion(frame, clock):
    assert frame.read().speed_mm_s == 0.0
    frame.go_to_displacement(1.0, 0.1)
    assert frame.read().speed_mm_s == pytest.approx(0.1)
    frame.change_speed(0.0123)
    assert frame.read().speed_mm_s == pytest.approx(0.0123)
    frame.hold()
    assert frame.read().speed_mm_s == 0.0


def test_a_speed_that_reads_back_otherwise_is_refused_and_motion_waits_for_a_hold(frame, device):
    device.spoil_speed(SpeedFault.WRONG)
    frame.go_to_displacement(1.0, 0.1)
    said = r"expected a set speed of 0\.2 mm/s, got 0\.1 mm/s on reading back"
    with pytest.raises(DeviceFault, match=said):
        frame.change_speed(0.2)
    with pytest.raises(DeviceFault, match="a speed that the machine did not take"):
        frame.go_to_displacement(2.0, 0.1)
    frame.hold()
    frame.go_to_displacement(2.0, 0.1)
    assert device.read().moving


def test_a_speed_finer_than_the_registers_is_no_other_speed(device, context, clock):
    server = LoadFrameServer(device, layout=LAYOUTS["scaled-integers"])
    with (
        closing(server),
        closing(open_frame(settings(server.address, map="scaled-integers"), context)) as frame,
    ):
        frame.go_to_displacement(1.0, 0.1)
        frame.change_speed(0.01234)
        clock.sleep(2.0)
        assert frame.read().speed_mm_s == pytest.approx(0.0123)
        with pytest.raises(DeviceFault, match="would be 0 in u32"):
            frame.change_speed(0.00004)
        assert frame.read().speed_mm_s == pytest.approx(0.0123)


@pytest.mark.parametrize(("before", "after"), [(0.1, 0.02), (0.02, 0.1)])
@pytest.mark.parametrize("map_name", LAYOUTS)
def test_a_crosshead_that_keeps_its_speed_is_noticed(device, context, clock, map_name, before, after):
    server = LoadFrameServer(device, layout=LAYOUTS[map_name])
    with closing(server), closing(open_frame(settings(server.address, map=map_name), context)) as frame:
        device.spoil_speed(SpeedFault.STUCK)
        frame.go_to_displacement(2.0, before)
        clock.sleep(0.5)
        frame.change_speed(after)

        def read_on() -> None:
            for _ in range(20):
                clock.sleep(0.1)
                frame.read()

        with pytest.raises(DeviceFault, match=r"expected the confirmed speed, got .* mm in .* s, not"):
            read_on()
        with pytest.raises(DeviceFault, match="a crosshead with another speed than confirmed"):
            frame.go_to_displacement(0.5, 0.1)
        frame.hold()
        assert device.read().holding
        frame.read()


def test_a_map_without_the_command_has_no_such_method(device, context, tmp_path):
    lines = (MAPS / "generic.toml").read_text().splitlines(keepends=True)
    (tmp_path / "old.toml").write_text("".join(line for line in lines if "change_speed" not in line))
    with closing(LoadFrameServer(device)) as server:
        old = settings(server.address, map=str(tmp_path / "old.toml"))
        assert not old.changes_speed
        assert settings(server.address).changes_speed
        with closing(open_frame(old, context)) as frame:
            assert not hasattr(frame, "change_speed")
            frame.go_to_displacement(0.1, 0.1)
            assert frame.read().moving


def test_a_change_that_a_hold_overtook_is_not_executed(port, device, context):
    frame = open_frame(settings(port.address, reply_timeout_s=30.0), context)
    frame.go_to_displacement(1.0, 0.1)
    arrived, release = Event(), Event()

    def slow(request: bytes, answer: Answer) -> bytes | None:
        if is_change(request):
            arrived.set()
            assert release.wait(60.0)
        return answer()

    port.tamper = slow
    with ThreadPoolExecutor(1) as pool:
        changing = pool.submit(frame.change_speed, 0.5)
        assert arrived.wait(60.0)
        frame.hold()
        release.set()
        with pytest.raises(DeviceFault, match="expected no hold meanwhile"):
            changing.result(60.0)
    assert device.read().holding
    assert not any(name.startswith("speed") for _, name in device.executed)
    frame.close()


def test_a_change_that_arrives_after_the_target_or_a_stop_starts_nothing(frame, port, device, clock):
    """The machine itself refuses it, because the driver cannot know what happens after its last reading."""
    frame.go_to_displacement(0.1, 0.1)

    def arrive_first(request: bytes, answer: Answer) -> bytes | None:
        if is_change(request):
            clock.sleep(1.5)
        return answer()

    port.tamper = arrive_first
    with pytest.raises(DeviceFault, match="no motion to a displacement is going on"):
        frame.change_speed(0.5)
    assert device.read().at_target

    frame.go_to_displacement(1.0, 0.1)
    port.tamper = lambda request, answer: (device.press_estop() if is_change(request) else None) or answer()
    with pytest.raises(DeviceFault, match="no motion to a displacement is going on"):
        frame.change_speed(0.5)
    assert not device.read().moving


def test_a_change_whose_answer_is_lost_is_proven_by_its_number(frame, port, device):
    frame.go_to_displacement(1.0, 0.1)
    port.tamper = lambda request, answer: None if answer() and is_change(request) else answer()
    port.commands.clear()
    frame.change_speed(0.2)
    assert len(port.commands) == 1
    assert device.read().set_speed_mm_s == pytest.approx(0.2)


def test_a_set_speed_that_is_none_is_no_reading(frame, port):
    frame.go_to_displacement(1.0, 0.1)

    def spoil(request: bytes, answer: Answer) -> bytes | None:
        reply = answer()
        if is_state(request) and reply is not None:
            reply = reply[: SET_SPEED_BYTES.start] + struct.pack(">f", float("nan"))
        return reply

    port.tamper = spoil
    with pytest.raises(DeviceFault, match="set_speed is no valid value"):
        frame.change_speed(0.2)


def test_after_the_guards_hold_no_change_moves_the_crosshead(guarded, device, clock):  # noqa: F811
    guarded.frame.go_to_displacement(1.0, 0.1)
    clock.sleep(1.0)
    guarded.frame.change_speed(0.2)
    guarded.guard.stop()
    with pytest.raises(DeviceError):
        guarded.frame.change_speed(0.5)
    stood_mm = device.displacement_mm()
    clock.sleep(2.0)
    assert (device.read().holding, device.displacement_mm()) == (True, stood_mm)


def test_a_change_that_was_on_its_way_at_the_guards_hold_is_not_executed(port, device, context):
    chosen = settings(port.address)
    with closing(ModbusGuard(chosen, context)) as guard, closing(open_frame(chosen, context)) as frame:
        frame.go_to_displacement(1.0, 0.1)
        late: list[bytes] = []

        def keep(request: bytes, answer: Answer) -> bytes | None:
            if is_change(request) and not late:
                late.append(request)
                guard.stop()
                return request[:5]
            return answer()

        port.tamper = keep
        with pytest.raises(DeviceFault, match="another program"):
            frame.change_speed(0.5)
        port.answer(1, late[0])
        assert device.read().holding
        assert not any(name.startswith("speed") for _, name in device.executed)
