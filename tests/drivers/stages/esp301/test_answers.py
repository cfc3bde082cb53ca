"""An answer of an ESP301 has no number and no checksum, but is never taken for that to another question."""

from concurrent.futures import ThreadPoolExecutor

import pytest

from drivers.errors import DeviceTimeout, LinkLost
from drivers.stages.esp301.stage import open_stage
from tests.drivers.stages.esp301.esp301_line import settings
from tests.drivers.stages.flood import flood
from tests.drivers.stages.stage_kit import arrive


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


def test_what_came_unasked_is_thrown_away(homed, line):
    line._port._send(b"77.0000\r\n")
    assert homed.read().angle_deg == 0.0
    assert "VE?" not in line.received


@pytest.mark.parametrize("data", [b"x" * 1000, b"x\n" * 500])
def test_a_peer_that_sends_without_end_is_told_in_time_and_in_one_short_line(context, data):
    with flood(data) as url, ThreadPoolExecutor(1) as pool:
        opening = pool.submit(open_stage, settings(url), context)
        with pytest.raises((DeviceTimeout, LinkLost)) as caught:
            opening.result(60.0)
    assert len(str(caught.value)) < 400


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
