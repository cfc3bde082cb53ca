"""Damaged, late and missing answers of a Zaber stage, and those of other devices, are never accepted."""

import threading
from concurrent.futures import ThreadPoolExecutor

import pytest

from drivers.errors import DeviceFault, DeviceTimeout, LinkLost
from drivers.stages.zaber.protocol import lrc
from drivers.stages.zaber.stage import open_stage
from simulators.stage.zaber import ZaberServer
from simulators.wire.ports import LOCALHOST
from tests.drivers.stages.stage_kit import Answer, arrive, untampered
from tests.drivers.stages.zaber.zaber_line import settings


def test_alerts_and_information_between_answers_are_no_answers(homed, line):
    line.tamper = lambda command, answer: b"!01 1 IDLE --\r\n#01 0 note\r\n" + answer()
    assert homed.read().angle_deg == 0.0
    assert line.received == ["get pos"]


def test_a_damaged_reading_is_asked_for_again(homed, line):
    damaged = iter([True])

    def once(command: str, answer: Answer) -> bytes:
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


def test_a_reading_that_is_always_damaged_says_what_came(homed, line):
    line.tamper = lambda command, answer: answer().replace(b"IDLE", b"BUSY")
    with pytest.raises(DeviceTimeout, match=r"damaged line '@01 1 .. OK BUSY -- 0:"):
        homed.read()
    assert line.received == ["get pos", "get pos"]


def test_a_late_answer_is_not_taken_for_the_next_ones(homed, line, clock):
    late: list[bytes] = []

    def delay(command: str, answer: Answer) -> bytes:
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
    def foreign(command: str, answer: Answer) -> bytes:
        body = answer().partition(b":")[0].replace(b"@01", b"@02")
        return body + b":%02X\r\n" % (-sum(body[1:]) & 0xFF)

    line.tamper = foreign
    with pytest.raises(DeviceFault, match="expected device 1, got an answer of device 2"):
        homed.read()


@pytest.mark.parametrize("by", ["the other end", "us"])
@pytest.mark.parametrize(("host", "url"), [(None, "{}"), (LOCALHOST, "socket://{}")])
def test_whoever_waits_for_an_answer_learns_at_once_that_the_link_is_lost(host, url, device, context, by):
    polled = threading.Event()

    class Mute(ZaberServer):
        def answer(self, line: bytes) -> bytes:
            if b"get pos" not in line:
                return super().answer(line)
            polled.set()
            return b""

    wire = Mute(device, host=host)
    stage = open_stage(settings(url.format(wire.address), reply_timeout_s=60.0), context)
    with ThreadPoolExecutor(1) as pool:
        reading = pool.submit(stage.read)
        assert polled.wait(60.0)
        wire.close() if by == "the other end" else stage.close()
        # long before the answer is overdue
        with pytest.raises(LinkLost):
            reading.result(60.0)
    stage.close()
    wire.close()


def test_an_answer_to_another_program_on_the_line_is_noticed(homed, line, clock):
    def beside(command: str, answer: Answer) -> bytes:
        reply = answer()
        own = int(reply.split()[2])
        other = (own + 25) % 100
        body = f"01 1 {other:02d} OK IDLE -- 0"
        return f"@{body}:{lrc(body)}\r\n".encode() + reply

    line.tamper = beside
    with pytest.raises(DeviceFault, match=r"got an answer to another program \(id \d+\)"):
        homed.read()
    line.tamper = untampered
    homed.home()
    arrive(homed, clock)
    homed.read()
