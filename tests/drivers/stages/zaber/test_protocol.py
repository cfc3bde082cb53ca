"""The driver's lines of the Zaber ASCII protocol equal those of the vendor's client. Damaged lines are
refused."""

import pytest

from drivers.stages.zaber.protocol import SPEED_UNIT, DamagedLineError, decode, encode


@pytest.mark.parametrize(
    ("request_", "line"),
    # recorded from the vendor's own client
    [
        ((0, 0, 0, ""), b"/0 0 00:00\n"),
        ((1, 0, 0, "get pos"), b"/1 0 00 get pos:2D\n"),
        ((1, 1, 15, "home"), b"/1 1 15 home:2F\n"),
        ((1, 1, 16, "warnings clear"), b"/1 1 16 warnings clear:47\n"),
        ((1, 1, 19, "move abs 200000"), b"/1 1 19 move abs 200000:85\n"),
    ],
)
def test_requests_are_byte_for_byte_those_of_the_vendors_client(request_, line):
    assert encode(*request_) == line


def test_a_reply_recorded_from_the_vendors_client_is_understood():
    reply = decode(b"@01 0 02 OK IDLE WR 0:BC")
    assert reply is not None
    assert (reply.address, reply.axis, reply.id) == (1, 0, 2)
    assert (reply.accepted, reply.busy, reply.flag, reply.data) == (True, False, "WR", "0")


@pytest.mark.parametrize(
    "line",
    [
        b"@01 0 02 OK IDLE WR 0:BD",  # wrong checksum
        b"@01 0 02 OK IDLE WR 1:BC",  # changed data
        b"@01 0 02 OK IDLE WR 0",  # no checksum
        b"@01 0 02 OK IDL",  # cut off
        b"\xff\x00:01",
        b"@01 0 02 OK IDLE WR \xb0:BC",  # a bit flipped that ASCII does not have
        b"",
    ],
)
def test_damaged_lines_are_told_apart(line):
    with pytest.raises(DamagedLineError):
        decode(line)


def test_alerts_and_information_answer_nothing():
    assert decode(b"!01 1 IDLE --:1F") is None
    assert decode(b"#01 0 visit www.zaber.com") is None


def test_twenty_degrees_per_second_are_209715_units():
    assert round(20 * 6400 * SPEED_UNIT) == 209715
