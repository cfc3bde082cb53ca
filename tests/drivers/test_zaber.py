import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor

import pytest

import drivers.guarded_stage
import drivers.zaber
from drivers.clock import VirtualClock
from drivers.errors import ConfigurationError, DeviceFault, DeviceTimeout, LinkLost
from drivers.interfaces import OpenContext
from drivers.registry import find_driver
from drivers.settings import validate
from drivers.zaber import ZaberStage, open_stage
from drivers.zaber_protocol import lrc
from drivers.zaber_settings import ZaberSettings
from simulators.stage_device import StageDevice
from simulators.stage_settings import StageSettings
from simulators.stage_wire import StageServer, StageTcpServer
from tests.drivers.flood import flood

# the faults among the constants of the vendor's client (zaber-motion, WarningFlags), one it has not got,
# and the limit switch, after which a motion has failed too
FAULTS = [f"F{letter}" for letter in "FNZHVOCMDQIARSBPETX"] + ["WL"]


class Line(StageServer):
    """A stage on a pty whose every message a test may see, change, lose or delay."""

    def __init__(self, device: StageDevice) -> None:
        self.received: list[str] = []
        self.tamper: Callable[[str, Callable[[], bytes]], bytes] = lambda command, answer: answer()
        super().__init__(device)

    def answer(self, line: bytes) -> bytes:
        command = line.decode().partition(":")[0].partition(" ")[2].partition(" ")[2].partition(" ")[2]
        self.received.append(command)
        return self.tamper(command, lambda: super(Line, self).answer(line))

    def motions(self) -> list[str]:
        return [command for command in self.received if command.startswith(("move", "home"))]


def lose(lost: str) -> Callable[[str, Callable[[], bytes]], bytes]:
    """The stage acts on commands that begin so, but its answer is lost."""

    def tamper(command: str, answer: Callable[[], bytes]) -> bytes:
        reply = answer()
        return b"" if command.startswith(lost) else reply

    return tamper


def settings(port: str, **changes: object) -> ZaberSettings:
    values = {"port": port, "angle_min_deg": -5.0, "angle_max_deg": 725.0, "reply_timeout_s": 5.0}
    return ZaberSettings.model_validate(values | changes)


@pytest.fixture
def device(clock: VirtualClock) -> StageDevice:
    return StageDevice(clock, power_up_angle_deg=12.0)


@pytest.fixture
def line(device: StageDevice) -> Iterator[Line]:
    server = Line(device)
    yield server
    server.close()


@pytest.fixture
def stage(line: Line, context: OpenContext) -> Iterator[ZaberStage]:
    opened = open_stage(settings(line.address, reply_timeout_s=0.5), context)
    yield opened
    opened.close()


@pytest.fixture
def homed(stage: ZaberStage, line: Line, clock: VirtualClock) -> ZaberStage:
    stage.home()
    arrive(stage, clock)
    line.received.clear()
    return stage


def arrive(stage: ZaberStage, clock: VirtualClock) -> float:
    """Wait in simulated time and return the angle."""
    for _ in range(10_000):
        state = stage.read()
        if not state.moving:
            return state.angle_deg
        clock.sleep(0.05)
    raise AssertionError("the stage never arrived")


@pytest.mark.parametrize(("server", "url"), [(StageServer, "{}"), (StageTcpServer, "socket://{}")])
def test_homes_and_turns_on_a_pty_and_on_tcp(server, url, device, clock, context):
    wire = server(device)
    try:
        stage = open_stage(settings(url.format(wire.address)), context)
        try:
            assert (stage.info.vendor, stage.info.serial) == ("Zaber", "110001")
            assert not stage.read().homed
            stage.home()
            arrive(stage, clock)
            assert stage.read().homed
            assert device.angle_deg() == pytest.approx(0.0, abs=1e-9)
            stage.move_to(382.5)
            assert arrive(stage, clock) == 382.5
            assert device.angle_deg() == pytest.approx(382.5, abs=1e-9)
        finally:
            stage.close()
            stage.close()
    finally:
        wire.close()
        wire.close()


def test_a_move_lasts_as_long_as_its_speed_says(homed, clock):
    start_s = clock.now_s()
    homed.move_to(90.0)
    arrive(homed, clock)
    # 90° at the default 10°/s, and 10/200 s to reach that speed; polled every 0.05 s
    assert clock.now_s() - start_s == pytest.approx(9.05, abs=0.051)


def test_limits_and_speed_are_in_the_stage(stage, device):
    assert (device.limit_min, device.limit_max) == (-5 * 6400, 725 * 6400)
    assert device.speed_microsteps_s == pytest.approx(10 * 6400, rel=1e-5)


def test_limits_can_be_moved_anywhere_in_the_right_order(device, line, context):
    for low, high in ((100.0, 110.0), (-20.0, -10.0), (5000.0, 5010.0)):
        open_stage(settings(line.address, angle_min_deg=low, angle_max_deg=high), context).close()
        assert (device.limit_min, device.limit_max) == (low * 6400, high * 6400)


def test_a_setting_that_the_stage_does_not_take_is_refused(line, context):
    acknowledge = b"@01 1 %02d OK IDLE -- 0"

    def ignore(command: str, answer: Callable[[], bytes]) -> bytes:
        if not command.startswith("set maxspeed"):
            return answer()
        body = acknowledge % (len(line.received) % 100)
        return body + b":%02X\r\n" % (-sum(body[1:]) & 0xFF)

    line.tamper = ignore
    with pytest.raises(DeviceFault, match="set maxspeed: expected 104858, got 209715 on reading back"):
        open_stage(settings(line.address), context)


@pytest.mark.parametrize("angle_deg", [-5.1, 725.1, float("nan"), float("inf")])
def test_angles_out_of_limits_are_refused_before_anything_is_sent(homed, line, angle_deg):
    with pytest.raises(DeviceFault, match="from -5° to 725°"):
        homed.move_to(angle_deg)
    assert line.received == []


def test_the_stages_own_rejection_is_told(homed, device):
    device.limit_max = 10 * 6400
    with pytest.raises(DeviceFault, match=r"BADDATA .*out of range"):
        homed.move_to(20.0)


@pytest.mark.parametrize(
    ("turn", "given"),
    [
        (2_304_000, 10_000.0),
        # 64 microsteps, 200 steps and a gear of 60: no whole number in a degree
        (768_000, 2133.33),
    ],
)
def test_a_scale_that_is_not_the_stages_own_is_refused_and_the_right_one_told(line, context, turn, given):
    line.tamper = lambda command, answer: (
        answered(answer(), f"OK IDLE WR {turn}") if "cycle" in command else answer()
    )
    found = rf"expected {round(360 * given)} microsteps in a turn, got {turn}; set microsteps_per_deg = "
    with pytest.raises(DeviceFault, match=found) as refused:
        open_stage(settings(line.address, microsteps_per_deg=given), context)
    told = float(refused.value.remedy.partition(" = ")[2].partition(",")[0])
    open_stage(settings(line.address, microsteps_per_deg=told), context).close()


def test_a_stage_that_does_not_know_its_turn_is_believed(line, context):
    def unknown(command: str, answer: Callable[[], bytes]) -> bytes:
        if command != "get limit.cycle.dist":
            return answer()
        body = answer().decode()[1:].partition(" OK")[0] + " RJ IDLE WR BADCOMMAND"
        return f"@{body}:{lrc(body)}\r\n".encode()

    line.tamper = unknown
    stage = open_stage(settings(line.address), context)
    assert not stage.read().homed
    stage.close()


def test_alerts_and_information_between_answers_are_no_answers(homed, line):
    line.tamper = lambda command, answer: b"!01 1 IDLE --\r\n#01 0 note\r\n" + answer()
    assert homed.read().angle_deg == 0.0
    assert line.received == ["get pos"]


def test_a_motion_by_an_angle_is_sent_as_an_absolute_one(homed, line, clock):
    homed.move_by(10.0)
    arrive(homed, clock)
    homed.move_by(-2.5)
    arrive(homed, clock)
    assert line.motions() == ["move abs 64000", "move abs 48000"]


def test_homing_switches_a_motor_driver_on_again(homed, device, line, clock):
    device.fail("FD")
    homed.home()
    arrive(homed, clock)
    assert "driver enable" in line.received
    assert homed.read().homed


def answered(reply: bytes, words: str) -> bytes:
    """The same answer with other words after the id, and the checksum they need."""
    body = " ".join([*reply.decode()[1:].split()[:3], words])
    return f"@{body}:{lrc(body)}\r\n".encode()


def test_a_home_command_that_never_arrived_is_no_home_search(homed, line, device):
    device.fail("FS")
    line.tamper = lambda command, answer: b"" if command == "home" else answer()
    # the stage still has the reference it had before it stalled, and stands still as if it had found it
    with pytest.raises(DeviceTimeout, match="home: expected a motion, got silence"):
        homed.home()
    line.tamper = lambda command, answer: answer()
    assert not homed.read().homed
    assert line.motions() == ["home"]


def test_a_home_search_whose_answer_is_lost_counts_when_it_has_ended(stage, line, clock):
    line.tamper = lose("home")
    stage.home()
    assert not stage.read().homed
    arrive(stage, clock)
    assert stage.read().homed
    assert line.motions() == ["home"]


@pytest.mark.parametrize("by", ["us", "somebody else"])
def test_a_stopped_search_after_a_fault_leaves_no_reference(homed, device, clock, by):
    stop = homed.stop if by == "us" else lambda: (device.stop(), clock.sleep(10.0))
    device.fail("FS")
    homed.home()
    stop()
    # the stage itself still calls its reference good
    assert homed.read().warnings == ("NI",)
    assert not homed.read().homed
    with pytest.raises(DeviceFault, match="home the stage first"):
        homed.move_to(10.0)
    homed.home()
    arrive(homed, clock)
    homed.move_to(10.0)
    assert arrive(homed, clock) == 10.0


def test_a_stopped_search_leaves_no_reference_though_another_program_cleared_the_flags(homed, device):
    device.fail("FS")
    homed.home()
    homed.stop()
    device.clear_flags()
    assert homed.read().warnings == ()
    assert not homed.read().homed


@pytest.mark.parametrize("begin", [ZaberStage.home, lambda stage: stage.move_to(90.0)], ids=["home", "move"])
def test_a_fault_in_motion_leaves_no_reference_though_it_went_by_itself(homed, device, begin):
    begin(homed)
    device.fail("FH")
    with pytest.raises(DeviceFault, match="emergency stop"):
        homed.read()
    device.enable_driver()
    # the stage itself still calls its reference good
    assert homed.read().warnings == ()
    assert not homed.read().homed


def test_a_reading_under_way_when_a_search_is_stopped_does_not_end_it(homed, device, monkeypatch):
    homed.home()
    query = homed._query

    def stop_first(*given: object) -> object:
        monkeypatch.undo()
        homed.stop()
        device.clear_flags()
        return query(*given)

    monkeypatch.setattr(homed, "_query", stop_first)
    assert not homed.read().homed
    assert not homed.read().homed


def test_homing_in_motion_is_refused(homed, line, clock):
    homed.move_to(90.0)
    clock.sleep(1.0)
    with pytest.raises(DeviceFault, match="home: expected a standing stage, got a stage in motion"):
        homed.home()
    assert line.motions() == ["move abs 576000"]


def test_a_fault_that_strikes_at_the_start_is_told_and_not_called_silence(homed, line, device):
    def stall(command: str, answer: Callable[[], bytes]) -> bytes:
        reply = answer()
        if not command.startswith("move"):
            return reply
        device.fail("FS")
        return b""

    line.tamper = stall
    with pytest.raises(DeviceFault, match="the stage stalled"):
        homed.move_to(45.0)


@pytest.mark.parametrize("reason", ["AGAIN", "STATUSBUSY", "REMOTE"])
def test_a_scale_that_the_stage_does_not_tell_just_now_is_not_taken_for_right(line, context, reason):
    line.tamper = lambda command, answer: (
        answered(answer(), f"RJ IDLE WR {reason}") if "cycle" in command else answer()
    )
    with pytest.raises(DeviceFault, match=f"limit.cycle.dist: expected acceptance, got rejection {reason}"):
        open_stage(settings(line.address, microsteps_per_deg=3200.0), context)


def test_a_refused_stop_is_no_standstill(homed, line, monkeypatch):
    monkeypatch.setattr(drivers.guarded_stage, "STOP_PATIENCE_S", 0.3)
    line.tamper = lambda command, answer: answered(answer(), "RJ IDLE -- AGAIN")
    with pytest.raises(DeviceTimeout, match=r"got rejection AGAIN .*press the emergency stop"):
        homed.stop()


def test_another_devices_standstill_is_not_this_ones(homed, line, device, clock, monkeypatch):
    monkeypatch.setattr(drivers.guarded_stage, "STOP_PATIENCE_S", 0.3)
    homed.move_to(90.0)
    clock.sleep(1.0)

    def foreign(command: str, answer: Callable[[], bytes]) -> bytes:
        body = line.readdressed(answer()).decode()[1:].partition(":")[0].replace("BUSY", "IDLE")
        return f"@{body}:{lrc(body)}\r\n".encode()

    line.tamper = foreign
    with pytest.raises(DeviceTimeout, match="an answer of device 2; press the emergency stop"):
        homed.stop()


@pytest.mark.parametrize("speed_deg_s", [0.0, -1.0, float("nan"), float("inf"), 1e308])
def test_a_speed_that_is_none_is_refused_before_anything_is_sent(homed, line, speed_deg_s):
    with pytest.raises(DeviceFault, match="set speed: expected a speed above 0 up to 10000°/s"):
        homed.set_speed(speed_deg_s)
    assert line.received == []


def test_a_port_is_released_whatever_breaks_off_the_opening(line, context, monkeypatch):
    def interrupted(stage: ZaberStage) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(ZaberStage, "_configure", interrupted)
        with pytest.raises(KeyboardInterrupt):
            open_stage(settings(line.address), context)
    open_stage(settings(line.address), context).close()


def test_a_flood_of_bytes_that_are_no_answer_is_told_in_one_short_line(context):
    with flood(b"x" * 1000) as url, pytest.raises(DeviceTimeout) as caught:
        open_stage(settings(url, reply_timeout_s=0.2), context)
    assert len(str(caught.value)) < 400


@pytest.mark.parametrize("angle_deg", [-5.1, 725.1, float("nan")])
def test_a_motion_by_an_angle_out_of_limits_is_refused_by_the_program_itself(homed, line, angle_deg):
    with pytest.raises(DeviceFault, match=r"move by .*expected an angle from -5° to 725°"):
        homed.move_by(angle_deg)
    assert line.received == ["get pos"]


def test_motion_without_a_reference_is_refused(stage, line):
    with pytest.raises(DeviceFault, match="home the stage first"):
        stage.move_to(10.0)
    assert line.motions() == []


def test_a_reference_lost_in_a_power_cut_is_noticed(homed, device):
    device.power_cycle()
    assert not homed.read().homed
    with pytest.raises(DeviceFault, match="no reference position"):
        homed.move_to(10.0)


def test_a_second_move_while_moving_is_refused(homed):
    homed.move_to(90.0)
    with pytest.raises(DeviceFault, match="a stage in motion"):
        homed.move_to(10.0)


@pytest.mark.parametrize("flag", FAULTS)
def test_a_failed_motion_is_a_fault_until_homing_acknowledges_it(homed, device, clock, flag):
    homed.move_to(90.0)
    clock.sleep(1.0)
    device.fail(flag)
    for _ in range(2):
        with pytest.raises(DeviceFault, match=f"read position: expected no fault, got .*{flag}"):
            homed.read()
    with pytest.raises(DeviceFault, match=flag):
        homed.move_to(10.0)
    device.enable_driver()
    homed.home()
    arrive(homed, clock)
    assert homed.read().warnings == ()


def test_an_interruption_warns_and_the_next_move_starts_clean(homed, device, clock):
    homed.move_to(90.0)
    clock.sleep(1.0)
    device.stop()
    clock.sleep(1.0)
    assert homed.read().warnings == ("NI",)
    homed.move_to(10.0)
    assert arrive(homed, clock) == 10.0
    assert homed.read().warnings == ()


def test_a_move_whose_answer_is_lost_is_never_sent_again(homed, line, device, clock):
    line.tamper = lose("move abs")
    homed.move_to(45.0)
    assert line.motions() == ["move abs 288000"]
    line.tamper = lambda command, answer: answer()
    assert arrive(homed, clock) == 45.0


def test_a_move_that_ended_before_its_answer_was_missed_is_done(homed, line, clock):
    def lose_and_arrive(command: str, answer: Callable[[], bytes]) -> bytes:
        reply = answer()
        if not command.startswith("move"):
            return reply
        clock.sleep(60.0)
        return b""

    line.tamper = lose_and_arrive
    homed.move_to(45.0)
    assert line.motions() == ["move abs 288000"]
    assert homed.read().angle_deg == 45.0


@pytest.mark.parametrize("command", ["home", "move"])
def test_a_stop_while_the_answer_to_a_motion_is_missing_is_told(homed, line, command):
    commanded = threading.Event()

    def lose_motion(sent: str, answer: Callable[[], bytes]) -> bytes:
        reply = answer()
        if not sent.startswith(command):
            return reply
        commanded.set()
        return b""

    line.tamper = lose_motion
    with ThreadPoolExecutor(1) as pool:
        moving = pool.submit(homed.home) if command == "home" else pool.submit(homed.move_to, 45.0)
        assert commanded.wait(30.0)
        homed.stop()
        with pytest.raises(DeviceFault, match="no stop meanwhile"):
            moving.result(30.0)


def test_a_home_search_that_was_stopped_before_it_was_known_to_have_begun_is_told(homed, line, monkeypatch):
    begin = homed._begin

    def begin_and_be_stopped(*given: object) -> None:
        begin(*given)
        homed.stop()

    monkeypatch.setattr(homed, "_begin", begin_and_be_stopped)
    with pytest.raises(DeviceFault, match="no stop meanwhile"):
        homed.home()
    assert not homed.read().homed


def test_a_move_that_never_arrived_is_reported_not_repeated(homed, line, device):
    line.tamper = lambda command, answer: b"" if command.startswith("move") else answer()
    with pytest.raises(DeviceTimeout, match="a stage that stands still"):
        homed.move_to(45.0)
    assert line.motions() == ["move abs 288000"]
    assert device.position == 0


def test_a_damaged_answer_to_a_move_counts_as_lost(homed, line, clock):
    line.tamper = lambda command, answer: (
        answer().replace(b"OK", b"OX") if command.startswith("move") else answer()
    )
    homed.move_to(45.0)
    assert len(line.motions()) == 1
    assert arrive(homed, clock) == 45.0


def test_a_damaged_reading_is_asked_for_again(homed, line):
    damaged = iter([True])

    def once(command: str, answer: Callable[[], bytes]) -> bytes:
        return answer().replace(b"IDLE", b"BUSY") if next(damaged, False) else answer()

    line.tamper = once
    assert not homed.read().moving
    assert line.received == ["get pos", "get pos"]


def test_a_reading_with_a_byte_that_is_no_ascii_is_damaged_and_the_next_is_understood(homed, line):
    damaged = iter([True])
    line.tamper = lambda command, answer: (
        answer().replace(b" 0:", b" \xb0:") if next(damaged, False) else answer()
    )
    assert homed.read().angle_deg == 0.0
    assert line.received == ["get pos", "get pos"]


def test_a_limit_that_is_no_number_is_told(line, context):
    def two_axes(command: str, answer: Callable[[], bytes]) -> bytes:
        reply = answer()
        if command != "get limit.min":
            return reply
        body = reply.decode().partition(":")[0] + " NA"
        return f"{body}:{lrc(body[1:])}\r\n".encode()

    line.tamper = two_axes
    with pytest.raises(DeviceFault, match=r"read limit\.min: expected a whole number, got '-23040000 NA'"):
        open_stage(settings(line.address), context)


def test_a_reading_that_is_always_damaged_says_what_came(homed, line):
    line.tamper = lambda command, answer: answer().replace(b"IDLE", b"BUSY")
    with pytest.raises(DeviceTimeout, match=r"damaged line '@01 1 .. OK BUSY -- 0:"):
        homed.read()
    assert line.received == ["get pos", "get pos"]


def test_a_late_answer_is_not_taken_for_the_next_ones(homed, line, clock):
    late: list[bytes] = []

    def delay(command: str, answer: Callable[[], bytes]) -> bytes:
        if not late:
            late.append(answer())
            clock.sleep(1.0)
            return b""
        return late[0] + answer()

    homed.move_to(90.0)
    line.tamper = delay
    # at rest for 0 s and 1 s after the start: only the second answer says 9.75°
    assert homed.read().angle_deg == pytest.approx(10 * (1.0 - 0.025), abs=1e-3)


def test_answers_of_another_device_are_refused(homed, line):
    def foreign(command: str, answer: Callable[[], bytes]) -> bytes:
        body = answer().partition(b":")[0].replace(b"@01", b"@02")
        return body + b":%02X\r\n" % (-sum(body[1:]) & 0xFF)

    line.tamper = foreign
    with pytest.raises(DeviceFault, match="expected device 1, got an answer of device 2"):
        homed.read()


def test_stop_goes_out_while_another_request_waits_for_its_answer(line, device, clock, context):
    stage = open_stage(settings(line.address, reply_timeout_s=30.0), context)
    stage.home()
    arrive(stage, clock)
    stage.move_to(90.0)
    clock.sleep(1.0)
    polled = threading.Event()
    held: list[bytes] = []

    def hold_back(command: str, answer: Callable[[], bytes]) -> bytes:
        if command == "get pos":
            held.append(answer())
            polled.set()
            return b""
        return answer()

    line.tamper = hold_back
    with ThreadPoolExecutor(1) as pool:
        reading = pool.submit(stage.read)
        assert polled.wait(30.0)
        stage.stop()
        assert not reading.done()
        assert not device.moving
        line.tamper = lambda command, answer: held.pop() + answer()
        # any further traffic brings the late answer along
        stage.stop()
        assert reading.result(30.0).moving
    stage.close()


@pytest.mark.parametrize("move", [ZaberStage.move_to, ZaberStage.move_by])
def test_stop_keeps_back_a_move_that_was_not_sent_yet(line, device, clock, context, move):
    stage = open_stage(settings(line.address, reply_timeout_s=30.0), context)
    stage.home()
    arrive(stage, clock)
    polled = threading.Event()
    held: list[bytes] = []

    def hold_back(command: str, answer: Callable[[], bytes]) -> bytes:
        if command == "get pos":
            held.append(answer())
            polled.set()
            return b""
        return (held.pop() if held else b"") + answer()

    line.received.clear()
    line.tamper = hold_back
    with ThreadPoolExecutor(1) as pool:
        moving = pool.submit(move, stage, 90.0)
        assert polled.wait(30.0)
        stage.stop()
        with pytest.raises(DeviceFault, match="no stop meanwhile"):
            moving.result(30.0)
    assert line.motions() == []
    stage.close()


def test_stop_is_repeated_until_standstill_is_confirmed(homed, line, device, clock):
    homed.move_to(90.0)
    clock.sleep(1.0)
    lost = iter([True, True])
    line.tamper = lambda command, answer: b"" if next(lost, False) else answer()
    homed.stop()
    assert not device.moving
    # two lost, then at least the one that began to brake and the one that saw the standstill
    assert line.received.count("stop") >= 4


def test_a_stop_that_is_never_confirmed_calls_for_the_emergency_stop(homed, line, monkeypatch):
    monkeypatch.setattr(drivers.guarded_stage, "STOP_PATIENCE_S", 0.3)
    line.tamper = lambda command, answer: b""
    with pytest.raises(DeviceTimeout, match="press the emergency stop"):
        homed.stop()


def test_a_stop_is_repeated_however_patient_the_rig_file_is(line, device, clock, context, monkeypatch):
    monkeypatch.setattr(drivers.zaber, "STOP_ANSWER_S", 0.1)
    stage = open_stage(settings(line.address, reply_timeout_s=60.0), context)
    lost = iter([True])
    line.tamper = lambda command, answer: b"" if next(lost, False) else answer()
    with ThreadPoolExecutor(1) as pool:
        # long before the answer to the first one is overdue
        pool.submit(stage.stop).result(30.0)
    assert line.received.count("stop") >= 2
    stage.close()


def test_a_mute_stage_is_a_timeout(line, context):
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
    wire = StageTcpServer(device)
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


def test_a_new_link_for_a_stop_is_not_waited_for_longer_than_a_stop_lasts(line, context, monkeypatch):
    opened = []

    class Noted(drivers.zaber.ZaberPort):
        def __init__(self, name: str, url: str, reply_timeout_s: float) -> None:
            opened.append(reply_timeout_s)
            super().__init__(name, url, reply_timeout_s)

    monkeypatch.setattr(drivers.zaber, "ZaberPort", Noted)
    stage = open_stage(settings(line.address, reply_timeout_s=60.0), context)
    line.faults.switch_on("unplug")
    line.faults.clear()
    stage.stop()
    assert opened == [60.0, 1.0]
    stage.close()


def test_a_stage_on_a_port_that_failed_is_stopped_over_the_same_port(homed, device, clock, monkeypatch):
    homed.move_to(90.0)
    clock.sleep(1.0)

    def fail(data: bytes) -> None:
        raise OSError("write timeout")

    monkeypatch.setattr(homed._port._channel, "send", fail)
    homed.stop()
    assert not device.moving


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
    wire = StageTcpServer(device)
    stage = open_stage(settings(f"socket://{wire.address}"), context)
    wire._port.drop_clients()
    wire.settings = StageSettings(device, 1, 7777)
    with pytest.raises(DeviceTimeout, match=r"expected standstill, got .*7777.*press the emergency stop"):
        stage.stop()
    stage.close()
    wire.close()


@pytest.mark.parametrize("by", ["the other end", "us"])
@pytest.mark.parametrize(("server", "url"), [(StageServer, "{}"), (StageTcpServer, "socket://{}")])
def test_whoever_waits_for_an_answer_learns_at_once_that_the_link_is_lost(server, url, device, context, by):
    polled = threading.Event()

    class Mute(server):
        def answer(self, line: bytes) -> bytes:
            if b"get pos" not in line:
                return super().answer(line)
            polled.set()
            return b""

    wire = Mute(device)
    stage = open_stage(settings(url.format(wire.address), reply_timeout_s=60.0), context)
    with ThreadPoolExecutor(1) as pool:
        reading = pool.submit(stage.read)
        assert polled.wait(30.0)
        wire.close() if by == "the other end" else stage.close()
        # long before the answer is overdue
        with pytest.raises(LinkLost):
            reading.result(30.0)
    stage.close()
    wire.close()


def test_a_port_that_does_not_exist_is_told(context):
    with pytest.raises(LinkLost, match="open port: expected a free serial port"):
        open_stage(settings("/dev/ttyNone"), context)


def test_a_port_in_use_is_told(stage, line, context):
    with pytest.raises(LinkLost, match="no other program"):
        open_stage(settings(line.address), context)


def test_a_simulated_name_without_a_simulated_rig_is_told(context):
    with pytest.raises(LinkLost, match="no simulated rig"):
        open_stage(settings("@stage"), context)


def test_a_simulated_rigs_stage_is_found_by_name_and_marked(line, clock):
    class Environment:
        addresses = {"stage": line.address}  # noqa: RUF012

    stage = open_stage(settings("@stage"), OpenContext("stage", clock, Environment()))
    assert stage.info.simulated
    stage.close()


def test_mistakes_in_the_rig_file_are_reported_together():
    spec = find_driver("zaber-ascii")
    table = {"port": 3, "angle_min_deg": 0.0, "angle_max_deg": float("nan"), "colour": "red"}
    with pytest.raises(ConfigurationError) as caught:
        validate(spec.settings, table, "rig.toml")
    assert len(caught.value.mistakes) == 3


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("microsteps_per_deg", 0.5),
        ("microsteps_per_deg", 1e30),
        ("speed_deg_s", 1e308),
        ("angle_min_deg", -1e300),
        ("angle_max_deg", 1e300),
    ],
)
def test_numbers_that_no_stage_can_mean_are_a_mistake(key, value):
    table = {"port": "/dev/ttyUSB0", "angle_min_deg": 0.0, "angle_max_deg": 9.0, key: value}
    with pytest.raises(ConfigurationError, match=key):
        validate(ZaberSettings, table, "rig.toml")


def test_crossed_limits_are_a_mistake():
    table = {"port": "/dev/ttyUSB0", "angle_min_deg": 10.0, "angle_max_deg": 0.0}
    with pytest.raises(ConfigurationError, match="angle_min_deg must be below angle_max_deg"):
        validate(ZaberSettings, table, "rig.toml")
