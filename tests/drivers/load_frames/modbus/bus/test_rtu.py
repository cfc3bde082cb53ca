"""Tests of Modbus RTU: the frames of the specification, and the problems of answers without numbers."""

import math
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise

import pytest

from drivers.clock import VirtualClock
from drivers.errors import DeviceFault, DeviceTimeout, LinkLost
from drivers.lines.channel import OvertakenError
from drivers.load_frames.modbus.bus.address import ModbusAddress
from drivers.load_frames.modbus.bus.link import ModbusLink, Overtaken
from drivers.load_frames.modbus.bus.wire import DamagedError, RtuWire, SilenceError, crc
from drivers.load_frames.modbus.settings import ModbusLoadFrameSettings
from tests.drivers.load_frames.modbus.bus.slaves import LONG_S, Slave, framed, linked


@pytest.fixture
def link(slave: Slave) -> Iterator[ModbusLink]:
    yield from linked(slave, LONG_S)


def test_the_checksum_is_that_of_the_specification():
    # MODBUS over Serial Line V1.02, 6.2.2: device 2, function 7
    assert crc(bytes.fromhex("02 07")) == bytes.fromhex("41 12")
    # a whole frame carries its own checksum down to nothing
    assert crc(framed("01 03 00 6B 00 03")) == bytes(2)


def test_a_read_is_the_bytes_of_the_specification(slave, link):
    slave.answer = lambda request: framed("01 04 02 000A")
    assert link.read("input", 8, 1) == [10]
    assert slave.requests == [framed("01 04 0008 0001")]


def test_a_write_is_the_bytes_of_the_specification(slave, link):
    slave.answer = lambda request: framed("01 10 0001 0002")
    link.write(1, [0x000A, 0x0102])
    slave.answer = lambda request: request
    link.write(1, [3], single=True)
    assert slave.requests == [framed("01 10 0001 0002 04 000A 0102"), framed("01 06 0001 0003")]


def test_a_coil_is_switched_by_the_bytes_of_the_specification(slave, link):
    # MODBUS Application Protocol V1.1b3, 6.5: the answer repeats the request
    slave.answer = lambda request: request
    link.write_coil(0xAC, on=True)
    link.write_coil(0xAC, on=False)
    assert slave.requests == [framed("01 05 00AC FF00"), framed("01 05 00AC 0000")]


def test_an_answer_for_another_coil_is_no_confirmation(slave, link):
    slave.answer = lambda request: framed("01 05 00AD FF00")
    with pytest.raises(LinkLost, match="switch coil 172 on"):
        link.write_coil(0xAC, on=True)


def test_an_exception_is_a_fault(slave, link):
    slave.answer = lambda request: framed("01 84 02")
    with pytest.raises(DeviceFault, match="illegal data address"):
        link.read("input", 0, 1)
    assert len(slave.requests) == 1


@pytest.mark.parametrize(
    ("answer", "got"),
    [
        (framed("01 04 02 000A")[:-1] + b"\x00", "damaged frame 01 04 02 00 0a"),
        (framed("01 04 02 000A")[:4], "the part 01 04 02 00"),
        (framed("01 04 02 000A") + framed("01 04 02 000B"), "more than one frame"),
        (b"", "none"),
    ],
)
def test_a_damaged_cut_doubled_or_missing_answer_is_a_timeout_that_says_so(slave, hasty, answer, got):
    slave.answer = lambda request: answer
    with pytest.raises(DeviceTimeout, match=got):
        hasty.read("input", 0, 1)
    # once more after quiet, and not a third time
    assert len(slave.requests) == 2


def test_the_same_answer_twice_is_one_answer(slave, link):
    slave.answer = lambda request: framed("01 04 02 000A") * 2
    assert [link.read("input", 8, 1) for _ in range(3)] == [[10]] * 3
    assert len(slave.requests) == 3


def test_what_came_before_a_request_is_not_its_answer(slave, link):
    slave.answer = lambda request: framed("01 04 02 000A")
    assert link.read("input", 8, 1) == [10]
    slave.say(framed("01 04 02 000B"))
    assert link.read("input", 8, 1) == [10]


def test_a_damaged_acknowledgement_is_not_followed_by_a_second_write(slave, hasty):
    slave.answer = lambda request: framed("01 10 0001 0001")[:-1] + b"\x00"
    with pytest.raises(DeviceTimeout):
        hasty.write(1, [7])
    assert len(slave.requests) == 1


@pytest.mark.parametrize("answer", ["02 04 02 000A", "01 03 02 000A", "01 04 04 000A 000B", "01 2B 0E 01"])
def test_an_answer_of_another_unit_function_or_length_is_not_believed(slave, hasty, answer):
    slave.answer = lambda request: framed(answer)
    with pytest.raises(LinkLost, match="nothing else answers at this address"):
        hasty.read("input", 8, 1)


def answers_one_late(times: int) -> Callable[[bytes], bytes]:
    """Return a function that sends answers one request too late, for the given number of requests."""
    late: list[bytes] = []
    left = iter(range(times))

    def answer(request: bytes) -> bytes:
        known = request[:4] == bytes.fromhex("01 04 0020")
        now = framed("01 04 06 0001 0002 0003") if known else framed("01 04 02 0007")
        before = late.pop() if late else b""
        if next(left, None) is None:
            return before + now
        late.append(now)
        return before

    return answer


def test_one_late_answer_is_waited_out_and_never_taken_for_the_next_ones(slave, hasty):
    hasty.prove_by("input", 32, [1, 2, 3])
    slave.answer = answers_one_late(1)
    assert hasty.read("input", 8, 1) == [7]
    # asked, late; the proof, and before its answer the late one, which is the answer
    assert [request[3] for request in slave.requests] == [8, 32]


def test_a_device_that_loses_the_check_while_it_is_busy_is_checked_by_fewer_registers(slave, hasty):
    hasty.prove_by("input", 32, [1, 2, 3])
    answers = [b"", framed("01 04 02 0007"), framed("01 04 04 0001 0002"), framed("01 04 02 0009")]
    slave.answer = lambda request: answers.pop(0)
    assert hasty.read("input", 8, 1) == [7]
    assert hasty.read("input", 8, 1) == [9]
    # address and count: asked, late; the check, which is lost; the check by fewer registers; asked once more
    assert [(request[3], request[5]) for request in slave.requests] == [(8, 1), (32, 3), (32, 2), (8, 1)]


def test_answers_that_are_always_one_late_are_never_believed(slave, hasty):
    """Without a silent line and a check, each answer would belong to the request before, for ever."""
    hasty.prove_by("input", 32, [1, 2, 3])
    slave.answer = answers_one_late(100)
    with pytest.raises((DeviceTimeout, LinkLost)):
        hasty.read("input", 8, 1)


def test_a_pseudo_terminal_is_opened_as_often_as_needed(slave):
    """A pseudo-terminal has no parity bit, and the system refuses to set its parity a second time."""
    slave.answer = lambda request: framed("01 04 02 000A")
    for _ in range(3):
        link = ModbusLink("frame", ModbusAddress(slave.path, parity="E"), unit=1, reply_timeout_s=LONG_S)
        assert link.read("input", 8, 1) == [10]
        link.close()


def test_what_is_urgent_ends_the_wait_of_others_and_their_reading_goes_on_after_it(slave, hasty):
    asked = threading.Event()

    def mute_first(request: bytes) -> bytes:
        if request[1] == 4 and not asked.is_set():
            asked.set()
            return b""
        return framed("01 10 0000 0001") if request[1] == 16 else framed("01 04 02 0005")

    slave.answer = mute_first
    with ThreadPoolExecutor(1) as pool:
        reading = pool.submit(hasty.read, "input", 8, 1)
        assert asked.wait(60.0)
        hasty.write(0, [1], urgent=True)
        assert reading.result(60.0) == [5]
    assert [request[1] for request in slave.requests] == [4, 16, 4]


def test_a_write_that_was_overtaken_is_not_repeated(slave, hasty):
    asked = threading.Event()

    def mute_first(request: bytes) -> bytes:
        if not asked.is_set():
            asked.set()
            return b""
        return framed("01 10 0000 0001")

    slave.answer = mute_first
    with ThreadPoolExecutor(1) as pool:
        writing = pool.submit(hasty.write, 9, [1])
        assert asked.wait(60.0)
        hasty.write(0, [1], urgent=True)
        with pytest.raises(Overtaken, match="a hold that went first"):
            writing.result(60.0)
    assert len(slave.requests) == 2


def test_a_broadcast_is_refused_because_nobody_would_answer_it():
    limits = {"load_max_n": 1000.0, "displacement_max_mm": 5.0}
    with pytest.raises(ValueError, match="broadcasts have no answer"):
        ModbusLoadFrameSettings(address="/dev/ttyUSB0", unit=0, **limits)
    # over TCP it is the usual number of a device that is alone at its address
    assert ModbusLoadFrameSettings(address="192.168.0.8:502", unit=0, **limits).unit == 0


@pytest.mark.parametrize("address", ["", "host", "host:0", "host:70000", "rtu://host", "tcp://", "host:port"])
def test_an_address_that_is_none_is_told(address):
    with pytest.raises(ValueError, match="expected host:port, rtu://host:port"):
        ModbusLoadFrameSettings(address=address, load_max_n=1.0, displacement_max_mm=1.0)


def test_a_baud_rate_over_tcp_is_told():
    with pytest.raises(ValueError, match="baud belong to a serial port"):
        ModbusLoadFrameSettings(address="host:502", baud=9600, load_max_n=1.0, displacement_max_mm=1.0)


class ScriptedWire:
    """A connection with given answers, which have no transaction numbers. It records the requests."""

    numbered = False

    def __init__(self, *answers: bytes | Exception) -> None:
        self.log: list[str] = []
        self._answers = list(answers)

    def ask(
        self, unit: int, pdu: bytes, timeout_s: float, wake: int | None, again_s: float = math.inf
    ) -> bytes:
        self.log.append(f"ask {pdu[2]}")
        answer = self._answers.pop(0)
        if isinstance(answer, Exception):
            raise answer
        return answer

    def quieten(self, silence_s: float, wake: int | None) -> None:
        self.log.append(f"quiet for {silence_s:g} s")

    def close(self) -> None: ...


@pytest.mark.parametrize("trouble", [SilenceError("none"), DamagedError("half"), OvertakenError()])
def test_after_a_missing_answer_the_line_is_quiet_and_proven_before_anything_else(monkeypatch, trouble):
    """Then a late answer is not taken for the answer to another request."""
    proof, answer = bytes.fromhex("04 02 0009"), bytes.fromhex("04 02 0007")
    wire = ScriptedWire(trouble, proof, answer, answer)
    monkeypatch.setattr(ModbusAddress, "open", lambda address, timeout_s: wire)
    link = ModbusLink("frame", ModbusAddress("/dev/ttyUSB0"), unit=1, reply_timeout_s=0.5)
    link.prove_by("input", 32, [9])
    assert link.read("input", 8, 1) == [7]
    assert wire.log == ["ask 8", "quiet for 0.5 s", "ask 32", "ask 8"]
    assert link.read("input", 8, 1) == [7]
    assert wire.log[4:] == ["ask 8"]
    link.close()


def test_connecting_never_takes_as_long_as_an_answer_may(monkeypatch):
    """On a shared link, a hold waits until connecting has ended."""
    timeouts_s: list[float] = []

    def unreachable(address: ModbusAddress, timeout_s: float) -> None:
        timeouts_s.append(timeout_s)
        raise TimeoutError

    monkeypatch.setattr(ModbusAddress, "open", unreachable)
    for reply_timeout_s in (60.0, 0.5):
        link = ModbusLink("frame", ModbusAddress("rtu://host:4001"), unit=1, reply_timeout_s=reply_timeout_s)
        with pytest.raises(LinkLost, match="expected a connection to rtu://host:4001"):
            link.write(0, [1])
        link.close()
    assert timeouts_s == [1.0, 0.5]


class Babble:
    """A channel that delivers the given number of bytes, one by one, with 10 ms between them."""

    def __init__(self, pieces: int) -> None:
        self.pieces = pieces
        self.clock = VirtualClock()

    def receive(self, deadline_s: float, wake: int | None) -> bytes:
        self.clock.sleep(0.01)
        self.pieces -= 1
        return b"?" if self.pieces >= 0 else b""


def test_quiet_is_waited_for_but_not_for_ever():
    channel = Babble(pieces=50)
    RtuWire(channel, 19_200, channel.clock).quieten(0.1, None)  # type: ignore[arg-type]
    assert channel.pieces == -1
    channel.pieces = 10**6
    with pytest.raises(SilenceError, match="other bytes without a pause"):
        RtuWire(channel, 19_200, channel.clock).quieten(0.1, None)  # type: ignore[arg-type]


class Recorder:
    """A channel that answers every request, and records the time at which each frame was sent."""

    def __init__(self, clock: VirtualClock) -> None:
        self.sent_s: list[float] = []
        self._clock = clock

    def discard(self) -> None: ...

    def send(self, data: bytes) -> None:
        self.sent_s.append(self._clock.now_s())

    def receive(self, deadline_s: float, wake: int | None) -> bytes:
        if wake is not None:
            raise OvertakenError
        return framed("01 04 02 000A")


@pytest.mark.parametrize(("baud", "gap_s"), [(9600, 3.5 * 11 / 9600), (115_200, 0.00175)])
def test_frames_are_apart_by_the_silence_of_the_specification(baud, gap_s):
    """MODBUS over Serial Line V1.02, 2.5.1.1: 3.5 characters of 11 bits, 1.750 ms above 19 200 baud."""
    clock = VirtualClock()
    channel = Recorder(clock)
    wire = RtuWire(channel, baud, clock)  # type: ignore[arg-type]
    request = bytes.fromhex("04 0008 0001")
    wire.ask(1, request, 1.0, None)
    wire.ask(1, request, 1.0, None)
    with pytest.raises(OvertakenError):
        wire.ask(1, request, 1.0, 0)
    wire.ask(1, request, 1.0, None)
    apart_s = [after - before for before, after in pairwise(channel.sent_s)]
    assert apart_s == pytest.approx([gap_s] * 3)
