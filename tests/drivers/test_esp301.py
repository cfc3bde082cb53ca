import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor

import pytest

import drivers.esp301
import drivers.guarded_stage
from drivers.clock import VirtualClock
from drivers.errors import ConfigurationError, DeviceFault, DeviceTimeout, LinkLost
from drivers.esp301 import EspStage, open_stage
from drivers.esp301_protocol import QueuedError, read_bits, read_error, read_name, read_number, read_switch
from drivers.esp301_settings import EspSettings
from drivers.interfaces import OpenContext
from drivers.registry import find_driver
from drivers.settings import validate
from simulators.newport_wire import NewportServer, NewportTcpServer
from simulators.stage_device import StageDevice
from tests.drivers.flood import flood


class Line(NewportServer):
    """A controller on a pty whose every message a test may see, change or lose."""

    def __init__(self, device: StageDevice, clock: VirtualClock) -> None:
        self.received: list[str] = []
        self.tamper: Callable[[str, Callable[[], bytes]], bytes] = lambda command, answer: answer()
        super().__init__(device, clock)

    def respond(self, message: bytes) -> bytes:
        self.received.append(message.decode())
        return self.tamper(message.decode(), lambda: super(Line, self).respond(message))

    def motions(self) -> list[str]:
        return [command for command in self.received if command[1:3] in ("OR", "PA", "PR", "MV")]


@pytest.fixture
def device(clock: VirtualClock) -> StageDevice:
    return StageDevice(clock, power_up_angle_deg=12.0)


@pytest.fixture
def line(device: StageDevice, clock: VirtualClock) -> Iterator[Line]:
    server = Line(device, clock)
    yield server
    server.close()


def settings(port: str, **changes: object) -> EspSettings:
    values = {"port": port, "angle_min_deg": -5.0, "angle_max_deg": 365.0, "reply_timeout_s": 0.5}
    return EspSettings.model_validate(values | changes)


@pytest.fixture
def stage(line: Line, context: OpenContext) -> Iterator[EspStage]:
    opened = open_stage(settings(line.address), context)
    yield opened
    opened.close()


@pytest.fixture
def homed(stage: EspStage, line: Line, clock: VirtualClock) -> EspStage:
    stage.home()
    arrive(stage, clock)
    line.received.clear()
    return stage


def arrive(stage: EspStage, clock: VirtualClock) -> float:
    for _ in range(10_000):
        state = stage.read()
        if not state.moving:
            return state.angle_deg
        clock.sleep(0.05)
    raise AssertionError("the stage never arrived")


def test_the_manuals_examples_of_answers_are_understood():
    assert read_error("0, 451322, NO ERROR DETECTED") == QueuedError(0, "NO ERROR DETECTED")
    assert str(read_error("108, 9512, MOTOR NOT CONNECTED")) == "error 108 (motor not connected)"
    assert (read_number("-0.0250"), read_number("1.5E-3"), read_switch("1")) == (-0.025, 0.0015, True)


@pytest.mark.parametrize("line", ["", "nan", "12,5", "0, NO ERROR", "ESP301 Version 3.0.1 6/1/99", "1 2"])
def test_what_is_no_answer_is_told(line):
    for read in (read_error, read_number, read_switch):
        with pytest.raises(ValueError, match="instead of"):
            read(line)


def test_errors_belong_to_the_controller_or_to_an_axis():
    assert QueuedError(4, "EMERGENCY STOP ACTIVATED").fails(1)
    assert QueuedError(106, "POSITIVE SOFTWARE LIMIT DETECTED").fails(1)
    assert not QueuedError(206, "POSITIVE SOFTWARE LIMIT DETECTED").fails(1)
    # noise on the line is no fault of the stage
    assert not QueuedError(6, "COMMAND DOES NOT EXIST").fails(1)


@pytest.mark.parametrize("number", [0, 2, 3, 4, 5, 8, 9, 18, 19, 20, 21, 22, 23, 29])
def test_errors_of_hardware_and_search_fail_the_motion(number):
    assert QueuedError(100 + number, "").fails(1)
    assert not QueuedError(100 + number, "").may_refuse(1)


@pytest.mark.parametrize("number", [1, 10, 11, 15, 30])
def test_errors_of_a_command_that_was_not_taken_fail_no_motion(number):
    assert not QueuedError(100 + number, "").fails(1)


def test_hexadecimal_settings_are_read_as_the_manual_writes_them():
    assert (read_bits("123H"), read_bits("0F25H"), read_bits("5")) == (0x123, 0xF25, 5)
    with pytest.raises(ValueError, match="instead of"):
        read_bits("5.0")


def test_the_version_is_no_stages_name():
    assert read_name("TS50DC.5, SN1263") == "TS50DC.5, SN1263"
    with pytest.raises(ValueError, match="instead of a stage's name"):
        read_name("ESP301 Version 3.0.1 6/1/99")


@pytest.mark.parametrize("bits", ["0H", "4H", "1H", "0F8H"])
def test_limits_that_the_controller_does_not_watch_are_refused(line, context, bits):
    line.soft_limits = bits
    with pytest.raises(DeviceFault, match="software limits that are watched and stop the stage"):
        open_stage(settings(line.address), context)


def test_a_home_search_that_looks_for_no_signal_is_refused(line, context):
    # 0 goes to where the counter is 0, wherever the stage was switched on
    line.home_mode = 0
    with pytest.raises(DeviceFault, match="a home search that looks for a signal"):
        open_stage(settings(line.address), context)
    with pytest.raises(ConfigurationError, match="home_mode"):
        validate(
            EspSettings, {"port": "x", "angle_min_deg": 0, "angle_max_deg": 1, "home_mode": 0}, "rig.toml"
        )


@pytest.mark.parametrize(("home_mode", "command"), [(None, "1OR1"), (4, "1OR4")])
def test_the_home_search_is_told_which_signals_to_look_for(line, context, home_mode, command):
    stage = open_stage(settings(line.address, home_mode=home_mode), context)
    stage.home()
    assert line.motions() == [command]
    stage.close()


def test_opening_sends_what_the_manual_says_and_moves_nothing(stage, line, device):
    assert line.received[0] == "VE?"
    assert line.motions() == []
    for command in ("1SR365.00000", "1SL-5.00000", "1VA10.00000", "1SN?"):
        assert command in line.received
    assert (device.limit_min, device.limit_max) == (-5 * 6400, 365 * 6400)
    assert (stage.info.model, stage.info.serial) == ("ESP301 with URS100BCC", "110001")
    assert stage.read().warnings == ("motor off",)


def test_limits_can_be_moved_anywhere_in_the_right_order(device, line, context):
    for low, high in ((100.0, 110.0), (-20.0, -10.0), (300.0, 310.0)):
        open_stage(settings(line.address, angle_min_deg=low, angle_max_deg=high), context).close()
        assert (device.limit_min, device.limit_max) == (low * 6400, high * 6400)


def test_another_unit_than_degrees_is_refused(line, context):
    line.tamper = lambda command, answer: b"2\r\n" if command == "1SN?" else answer()
    with pytest.raises(DeviceFault, match=r"read unit: expected degrees \(7\), got unit 2"):
        open_stage(settings(line.address), context)


def test_a_limit_that_is_not_taken_is_refused(line, context):
    line.tamper = lambda command, answer: b"180.0\r\n" if command == "1SR?" else answer()
    with pytest.raises(DeviceFault, match="set right limit: expected 365, got 180 on reading back"):
        open_stage(settings(line.address), context)


def test_a_speed_beyond_the_stages_own_is_refused(line, context):
    with pytest.raises(DeviceFault, match="a speed above 0 up to 40°/s, got 41°/s"):
        open_stage(settings(line.address, speed_deg_s=41.0), context)


def test_a_refused_move_is_told_with_the_controllers_reason(homed, line):
    line.faults.switch_on("error:115:1")
    with pytest.raises(DeviceFault, match=r"move to 20°: expected acceptance, got error 115 \(axis-1 max"):
        homed.move_to(20.0)


def test_a_move_that_never_arrived_is_reported_not_repeated(homed, line, device):
    line.tamper = lambda command, answer: b"" if command.startswith("1PA") else answer()
    with pytest.raises(DeviceTimeout, match="expected a motion, got a stage that stands still"):
        homed.move_to(20.0)
    assert line.motions() == ["1PA20.00000"]
    assert device.position == 0


def test_a_failure_that_another_command_heard_of_first_is_not_forgotten(homed, device, clock):
    homed.move_to(90.0)
    clock.sleep(1.0)
    # a limit switch stops the stage, and leaves the motor on
    device.fail("FE")
    with pytest.raises(DeviceFault, match="set speed: expected acceptance, got error 104"):
        homed.set_speed(5.0)
    for _ in range(2):
        with pytest.raises(DeviceFault, match="read position: expected no fault, got error 104"):
            homed.read()
    homed.home()
    arrive(homed, clock)
    assert homed.read().homed


def test_a_move_beyond_the_controllers_limits_is_refused_and_fails_nothing(homed, line):
    line.faults.switch_on("error:106:1")
    with pytest.raises(DeviceFault, match=r"move to 20°: expected acceptance, got error 106"):
        homed.move_to(20.0)
    assert homed.read().homed


def test_a_home_search_whose_error_may_have_been_lost_found_nothing(stage, line, device, clock):
    stage.home()
    clock.sleep(0.1)
    # the search hits a limit switch, and nobody hears of it: reading the queue has emptied it
    device.fail("FE")
    lost = iter([True])

    def lose(command: str, answer: Callable[[], bytes]) -> bytes:
        reply = answer()
        return b"" if command == "TB?" and next(lost, False) else reply

    line.tamper = lose
    assert not stage.read().homed
    assert not stage.read().homed


def test_a_home_search_that_was_stopped_before_it_was_known_to_have_begun_is_told(homed, monkeypatch):
    confirm = homed._confirm_start

    def confirm_and_be_stopped(*given: object) -> None:
        confirm(*given)
        homed.stop()

    monkeypatch.setattr(homed, "_confirm_start", confirm_and_be_stopped)
    with pytest.raises(DeviceFault, match="no stop meanwhile"):
        homed.home()
    assert not homed.read().homed


@pytest.mark.parametrize("command", ["1OR", "1PA"])
def test_a_stop_that_comes_before_the_start_was_seen_is_told(homed, line, command):
    commanded, lost = threading.Event(), iter([True])

    def lose_first_error(sent: str, answer: Callable[[], bytes]) -> bytes:
        reply = answer()
        if sent.startswith(command):
            commanded.set()
        return b"" if commanded.is_set() and sent == "TB?" and next(lost, False) else reply

    line.tamper = lose_first_error
    with ThreadPoolExecutor(1) as pool:
        moving = pool.submit(homed.home) if command == "1OR" else pool.submit(homed.move_to, 45.0)
        assert commanded.wait(30.0)
        homed.stop()
        with pytest.raises(DeviceFault, match="no stop meanwhile"):
            moving.result(30.0)


def test_a_home_command_that_never_arrived_is_reported(homed, line, device):
    line.tamper = lambda command, answer: b"" if command.startswith("1OR") else answer()
    with pytest.raises(DeviceTimeout, match="home: expected a motion, got a stage that stands still"):
        homed.home()
    assert not homed.read().homed
    assert line.motions() == ["1OR1"]


def test_a_reading_begun_before_the_home_search_does_not_end_it(stage, line):
    def begin_search(command: str, answer: Callable[[], bytes]) -> bytes:
        reply = answer()
        if command == "1MD?":
            stage._reference.seek()
        return reply

    line.answer(b"1MO")
    line.tamper = begin_search
    # the stage stood when it was asked, for it had not begun yet
    assert not stage.read().homed


def test_a_power_cut_right_after_the_start_of_a_home_search_is_noticed(stage, device):
    stage.home()
    device.power_cycle()
    with pytest.raises(DeviceFault, match="motor off: a reset"):
        stage.read()


def test_errors_from_before_the_opening_are_no_fault(line, device, context):
    line.answer(b"1MO")
    device.fail("FE")
    stage = open_stage(settings(line.address), context)
    state = stage.read()
    assert (state.homed, state.warnings) == (False, ())
    stage.close()


def test_homing_in_motion_is_refused(homed, line, clock):
    homed.move_to(90.0)
    clock.sleep(1.0)
    with pytest.raises(DeviceFault, match="home: expected a standing stage, got a stage in motion"):
        homed.home()
    assert line.motions() == ["1PA90.00000"]


@pytest.mark.parametrize("speed_deg_s", [0.0, -1.0, float("nan"), float("inf")])
def test_a_speed_that_is_none_is_refused(homed, line, speed_deg_s):
    with pytest.raises(DeviceFault, match="set speed: expected a speed above 0 up to 40°/s"):
        homed.set_speed(speed_deg_s)
    assert not [command for command in line.received if command.startswith("1VA")]


@pytest.mark.parametrize("data", [b"x" * 1000, b"x\n" * 500])
def test_a_peer_that_sends_without_end_is_told_in_time_and_in_one_short_line(context, data):
    with flood(data) as url, ThreadPoolExecutor(1) as pool:
        opening = pool.submit(open_stage, settings(url), context)
        with pytest.raises((DeviceTimeout, LinkLost)) as caught:
            opening.result(30.0)
    assert len(str(caught.value)) < 400


def test_a_stop_under_a_flood_ends_in_time(homed, line, monkeypatch):
    monkeypatch.setattr(drivers.guarded_stage, "STOP_PATIENCE_S", 0.3)
    line.tamper = lambda command, answer: b"x\n" * 2000
    with ThreadPoolExecutor(1) as pool, pytest.raises(DeviceTimeout, match="press the emergency stop"):
        pool.submit(homed.stop).result(30.0)


def test_a_move_to_where_it_stands_is_done(homed):
    homed.move_to(0.0)
    assert homed.read().angle_deg == 0.0


def test_an_open_emergency_stop_is_a_fault_until_homing_acknowledges_it(homed, device, clock):
    homed.move_to(90.0)
    clock.sleep(1.0)
    device.press_estop()
    for _ in range(2):
        with pytest.raises(DeviceFault, match="read position: expected no fault, got error 4"):
            homed.read()
    with pytest.raises(DeviceFault, match="emergency stop"):
        homed.home()
    device.release_estop()
    homed.home()
    arrive(homed, clock)
    assert homed.read().homed


def test_a_reset_is_noticed_by_the_motor_that_is_off(homed, device):
    device.power_cycle()
    with pytest.raises(DeviceFault, match="motor off: a reset, a power cut or an emergency stop"):
        homed.read()


def test_a_reset_and_a_motor_switched_on_behind_our_back_are_noticed_by_the_limits(homed, device, line):
    device.power_cycle()
    line.answer(b"VE?")
    line.answer(b"1MO")
    device.limit_max = 170 * 6400
    assert homed.read().homed
    with pytest.raises(DeviceFault, match="the limit 365° that was set, got 170°: the controller was reset"):
        homed.move_to(20.0)
    assert not homed.read().homed
    assert line.motions() == []


def test_a_disturbed_digit_of_a_standing_stages_position_is_noticed(homed, line, clock):
    homed.move_to(90.0)
    arrive(homed, clock)
    disturbed = iter([True])
    line.tamper = lambda command, answer: (
        b"70.0000\r\n" if command == "1TP" and next(disturbed, False) else answer()
    )
    assert homed.read().angle_deg == 90.0
    wandering = iter(range(100))
    line.tamper = lambda command, answer: (
        f"{next(wandering)}.0\r\n".encode() if command == "1TP" else answer()
    )
    with pytest.raises(DeviceTimeout, match="two readings in a row that agree while the stage stands"):
        homed.read()


@pytest.mark.parametrize(
    "fault", ["late:3", "late:4", "stale:1", "stale:2", "corrupt:1", "duplicate:3", "drop:1"]
)
def test_a_shifted_damaged_or_missing_answer_is_never_taken_for_another_questions(homed, line, clock, fault):
    homed.move_to(90.0)
    arrive(homed, clock)
    line.faults.switch_on(fault)
    for _ in range(4):
        try:
            state = homed.read()
        except DeviceTimeout:
            continue
        assert (state.angle_deg, state.moving, state.homed) == (90.0, False, True)
    line.faults.clear()
    assert homed.read().angle_deg == 90.0


def test_stop_goes_out_while_a_question_waits_and_the_question_is_asked_again(homed, line, device, clock):
    homed.move_to(90.0)
    clock.sleep(1.0)
    polled = threading.Event()

    def swallow_first(command: str, answer: Callable[[], bytes]) -> bytes:
        if command == "1TP" and not polled.is_set():
            polled.set()
            return b""
        return answer()

    line.tamper = swallow_first
    with ThreadPoolExecutor(1) as pool:
        reading = pool.submit(homed.read)
        assert polled.wait(30.0)
        homed.stop()
        assert not device.moving
        assert 0.0 < reading.result(30.0).angle_deg < 90.0


@pytest.mark.parametrize("move", [EspStage.move_to, EspStage.move_by])
def test_stop_keeps_back_a_move_that_was_not_sent_yet(homed, line, move):
    polled = threading.Event()

    def swallow_first(command: str, answer: Callable[[], bytes]) -> bytes:
        if command == "1TP" and not polled.is_set():
            polled.set()
            return b""
        return answer()

    line.tamper = swallow_first
    with ThreadPoolExecutor(1) as pool:
        moving = pool.submit(move, homed, 90.0)
        assert polled.wait(30.0)
        homed.stop()
        with pytest.raises(DeviceFault, match="no stop meanwhile"):
            moving.result(30.0)
    assert line.motions() == []


def test_a_stop_need_not_wait_for_the_end_of_a_question(line, device, clock, context):
    stage = open_stage(settings(line.address, reply_timeout_s=60.0), context)
    polled = threading.Event()

    def swallow_first(command: str, answer: Callable[[], bytes]) -> bytes:
        if command == "1TP" and not polled.is_set():
            polled.set()
            return b""
        return answer()

    line.tamper = swallow_first
    with ThreadPoolExecutor(2) as pool:
        reading = pool.submit(stage.read)
        assert polled.wait(30.0)
        pool.submit(stage.stop).result(30.0)
        reading.result(30.0)
    stage.close()


@pytest.mark.parametrize("late", [0, 1])
def test_a_stray_answer_does_not_confirm_a_standstill(homed, line, clock, monkeypatch, late):
    homed.move_to(90.0)
    clock.sleep(1.0)
    held: list[bytes] = []

    def stray(command: str, answer: Callable[[], bytes]) -> bytes:
        if command == "1ST":
            return b""  # nor does the stop arrive
        if command == "1MD?":
            held.append(answer())
            return b"1\r\n" + (b"" if late else held.pop())
        return (held.pop() if held else b"") + answer()

    line.tamper = stray
    monkeypatch.setattr(drivers.guarded_stage, "STOP_PATIENCE_S", 0.3)
    with pytest.raises(DeviceTimeout, match="press the emergency stop"):
        homed.stop()
    line.tamper = lambda command, answer: answer()
    line.received.clear()
    assert homed.read().moving
    # the stop's own last question may be heard only now
    assert "VE?" in line.received[: line.received.index("1TP")]


def test_what_came_unasked_is_thrown_away(homed, line):
    line._port._send(b"77.0000\r\n")
    assert homed.read().angle_deg == 0.0
    assert "VE?" not in line.received


def test_an_answer_torn_by_noise_is_asked_for_again(homed, line, clock):
    homed.move_to(15.0)
    clock.sleep(1.0)
    torn = iter([True])
    line.tamper = lambda command, answer: (
        answer().replace(b".", b"\n", 1) if command == "1TP" and next(torn, False) else answer()
    )
    # in motion it is asked for once only: 10 °/s, less the start
    assert homed.read().angle_deg == pytest.approx(10 * (1.0 - 0.025), abs=1e-3)
    assert line.received[line.received.index("VE?") - 1] == "1TP"


def test_a_port_that_cannot_be_written_to_is_lost_for_good(homed, monkeypatch):
    sent = []

    def fail(data: bytes) -> None:
        sent.append(data)
        raise OSError("the hub is off")

    monkeypatch.setattr(homed._port._channel, "send", fail)
    for _ in range(2):
        with pytest.raises(LinkLost, match="the hub is off"):
            homed._port.send("1ST")
    assert sent == [b"1ST\r"]


def test_stop_is_repeated_until_standstill_is_confirmed(homed, line, device, clock):
    homed.move_to(90.0)
    clock.sleep(1.0)
    lost = iter([True, True])
    line.tamper = lambda command, answer: b"" if command == "1ST" and next(lost, False) else answer()
    homed.stop()
    assert not device.moving
    assert line.received.count("1ST") >= 3


def test_a_stop_is_repeated_however_patient_the_rig_file_is(line, context, monkeypatch):
    monkeypatch.setattr(drivers.esp301, "STOP_ANSWER_S", 0.1)
    stage = open_stage(settings(line.address, reply_timeout_s=60.0), context)
    lost = iter([True])
    line.tamper = lambda command, answer: b"" if command == "1MD?" and next(lost, False) else answer()
    with ThreadPoolExecutor(1) as pool:
        # long before the answer to the first question is overdue
        pool.submit(stage.stop).result(30.0)
    assert line.received.count("1ST") >= 2
    stage.close()


def test_a_stop_that_is_never_confirmed_calls_for_the_emergency_stop(homed, line, monkeypatch):
    monkeypatch.setattr(drivers.guarded_stage, "STOP_PATIENCE_S", 0.3)
    line.tamper = lambda command, answer: b""
    with pytest.raises(DeviceTimeout, match="press the emergency stop"):
        homed.stop()


def test_a_mute_controller_is_a_timeout(line, context):
    line.tamper = lambda command, answer: b""
    with pytest.raises(DeviceTimeout, match=r"expected an answer within 0\.05 s, got silence"):
        open_stage(settings(line.address, reply_timeout_s=0.05), context)


def test_a_lost_link_is_told_by_every_call(homed, line):
    line.close()
    for call in (homed.read, homed.home, lambda: homed.move_to(1.0)):
        with pytest.raises(LinkLost, match="check the cable"):
            call()
    # nobody knows whether it still moves
    with pytest.raises(LinkLost, match="press the emergency stop"):
        homed.stop()


def test_a_stage_whose_link_was_cut_in_motion_is_stopped_over_a_new_one(device, clock, context):
    wire = NewportTcpServer(device, clock)
    stage = open_stage(settings(f"socket://{wire.address}"), context)
    stage.home()
    arrive(stage, clock)
    stage.move_to(90.0)
    clock.sleep(1.0)
    wire._port.drop_clients()
    stage.stop()
    assert not device.moving
    assert 0.0 < device.angle_deg() < 90.0
    # for anything else it must be opened again
    with pytest.raises(LinkLost, match="open the stage again"):
        stage.read()
    stage.close()
    with pytest.raises(LinkLost, match="press the emergency stop"):
        stage.stop()
    wire.close()


def test_a_stage_whose_cable_is_back_is_stopped(homed, line, device, clock):
    homed.move_to(90.0)
    clock.sleep(1.0)
    line.faults.switch_on("unplug")
    with pytest.raises(LinkLost, match="press the emergency stop"):
        homed.stop()
    line.faults.clear()
    homed.stop()
    assert not device.moving


def test_another_stage_where_ours_was_is_not_ours_standing_still(device, clock, context, monkeypatch):
    monkeypatch.setattr(drivers.guarded_stage, "STOP_PATIENCE_S", 0.3)
    wire = NewportTcpServer(device, clock)
    stage = open_stage(settings(f"socket://{wire.address}"), context)
    wire._port.drop_clients()
    wire._serial = 7777
    with pytest.raises(DeviceTimeout, match=r"expected standstill, got .*7777.*press the emergency stop"):
        stage.stop()
    stage.close()
    wire.close()


def test_a_port_in_use_is_told(stage, line, context):
    with pytest.raises(LinkLost, match="no other program"):
        open_stage(settings(line.address), context)


def test_mistakes_in_the_rig_file_are_reported_together():
    spec = find_driver("newport-esp301")
    table = {"port": 3, "axis": 4, "angle_min_deg": 0.0, "angle_max_deg": float("nan"), "colour": "red"}
    with pytest.raises(ConfigurationError) as caught:
        validate(spec.settings, table, "rig.toml")
    assert len(caught.value.mistakes) == 4
