import os
import socket
import threading

import pytest

from simulators.stage.device import StageDevice
from simulators.stage.zaber import ZaberServer
from tests.simulators.terminal import listen, terminal_of
from tests.tcp_servers import zaber_on_tcp


@pytest.fixture
def server(clock, serve):
    return serve(ZaberServer(StageDevice(clock)))


@pytest.mark.parametrize(
    ("message", "reply"),
    [
        # checksums of the vendor's client; the reply's is the recorded `@01 0 02 OK IDLE WR 0:BC`
        (b"/1 0 02:FD", b"@01 0 02 OK IDLE WR 0:BC\r\n"),
        (b"/1 0 00 get pos:2D", b"@01 0 00 OK IDLE WR 0:BE\r\n"),
        # the dialect without ids and checksums
        (b"/", b"@01 0 OK IDLE WR 0\r\n"),
        (b"/get pos", b"@01 0 OK IDLE WR 0\r\n"),
        (b"/1 1 get maxspeed", b"@01 1 OK IDLE WR 209715\r\n"),
        (b"/01 1 7 warnings", b"@01 1 07 OK IDLE WR 01 WR\r\n"),
        # refusals
        (b"/1 1 07 fly", b"@01 1 07 RJ IDLE WR BADCOMMAND\r\n"),
        (b"/1 2 07 home", b"@01 2 07 RJ IDLE WR BADAXIS\r\n"),
        (b"/1 1 07 move abs 99999999", b"@01 1 07 RJ IDLE WR BADDATA\r\n"),
        (b"/1 1 07 move abs far", b"@01 1 07 RJ IDLE WR BADDATA\r\n"),
        (b"/1 1 07 set maxspeed " + b"9" * 400, b"@01 1 07 RJ IDLE WR BADDATA\r\n"),
        (b"/1 1 07 set colour 5", b"@01 1 07 RJ IDLE WR BADCOMMAND\r\n"),
        # not for this stage, damaged, no reply wanted, no message
        (b"/2 0 07", b""),
        (b"/1 0 00 get pos:2E", b""),
        (b"/1 0 -- get pos", b""),
        (b"hello", b""),
        (b"\xff\xfe", b""),
    ],
)
def test_answers_as_the_manual_says(server, message, reply):
    assert server.answer(message) == reply


def test_everybody_answers_to_address_0(server):
    assert server.answer(b"/0 0 05:FB") == server.answer(b"/1 0 05:FA")


def test_a_move_is_busy_and_then_idle(server, clock):
    assert b" OK BUSY " in server.answer(b"/1 1 01 move abs 64000")
    clock.sleep(1.0)
    assert server.answer(b"/1 1 02 get pos").split()[4:] == [b"IDLE", b"WR", b"64000"]


def test_every_kind_of_move(server, clock):
    for command, position in (
        (b"move abs 64000", 64_000),
        (b"move rel -1000", 63_000),
        (b"move min", -23_040_000),
        (b"move abs 0 104858 100", 0),
        (b"move vel 104858", 23_040_000),  # as far as the limit
    ):
        assert b" OK BUSY " in server.answer(b"/1 1 01 " + command)
        clock.sleep(2000.0)
        assert server.answer(b"/1 1 02 get pos").split()[4:] == [b"IDLE", b"WR", b"%d" % position]
    assert b" RJ " in server.answer(b"/1 1 01 move abs")
    assert b" RJ " in server.answer(b"/1 1 01 move abs 1 -5")
    assert b" RJ " in server.answer(b"/1 1 01 move sideways 5")


def test_a_move_may_have_a_speed_of_its_own(server, clock):
    # 104858 / 1.6384 microsteps/s are 10°/s
    server.answer(b"/1 1 01 move abs 640000 104858")
    clock.sleep(5.0)
    assert server.device.angle_deg() == pytest.approx(50.0, abs=0.5)
    server.answer(b"/1 1 01 move vel 0")
    clock.sleep(1.0)
    assert not server.device.moving


def test_a_parked_stage_refuses_motion_and_keeps_its_reference_over_a_power_cut(server, clock):
    server.answer(b"/1 1 01 home")
    clock.sleep(5.0)
    server.answer(b"/1 1 01 move abs 6400")
    clock.sleep(5.0)
    assert server.answer(b"/1 1 02 tools parking park") == b"@01 1 02 OK IDLE -- 0\r\n"
    assert server.answer(b"/1 1 03 move abs 0") == b"@01 1 03 RJ IDLE -- PARKED\r\n"
    server.answer(b"/1 0 04 system reset")
    assert server.answer(b"/1 1 05 get pos") == b"@01 1 05 OK IDLE -- 6400\r\n"
    server.answer(b"/1 1 06 tools parking unpark")
    assert b" OK BUSY " in server.answer(b"/1 1 07 move abs 0")


def test_a_driver_that_is_off_takes_no_motion(server):
    server.answer(b"/1 1 01 driver disable")
    assert server.answer(b"/1 1 02 home") == b"@01 1 02 RJ IDLE FO DRIVERDISABLED\r\n"
    assert server.answer(b"/1 1 03 get driver.enabled") == b"@01 1 03 OK IDLE FO 0\r\n"
    server.answer(b"/1 1 04 driver enable")
    assert b" OK BUSY " in server.answer(b"/1 1 05 home")


def test_a_stage_takes_another_address_and_answers_with_checksums_when_told(server):
    assert server.answer(b"/1 0 01 renumber 7") == b"@07 0 01 OK IDLE WR 0\r\n"
    assert server.answer(b"/1 0 02") == b""
    assert server.answer(b"/7 0 03 set comm.checksum 1").endswith(b":B5\r\n")
    assert server.answer(b"/7 1 04 get comm.checksum") == b"@07 1 04 RJ IDLE WR DEVICEONLY:EF\r\n"


def test_bytes_may_come_in_pieces_on_the_terminal(server):
    with terminal_of(server.address) as terminal:
        for piece in (b"/1 0 0", b"0 get pos:2D\r", b"\n/1 0 01 get pos:2C\n"):
            os.write(terminal, piece)
        expected = b"@01 0 00 OK IDLE WR 0:BE\r\n@01 0 01 OK IDLE WR 0:BD\r\n"
        assert listen(terminal, len(expected)) == expected


def test_clients_on_tcp_share_one_stage(clock):
    server = zaber_on_tcp(StageDevice(clock))
    host, _, port = server.address.partition(":")
    before = threading.active_count()
    try:
        with socket.create_connection((host, int(port)), 10.0) as one:
            with one.makefile("rb") as lines:
                one.sendall(b"/1 1 01 move abs 6400\n")
                assert lines.readline() == b"@01 1 01 OK BUSY WR 0\r\n"
            clock.sleep(1.0)
            with socket.create_connection((host, int(port)), 10.0) as other:
                other.sendall(b"/1 1 01 get pos\n")
                assert other.makefile("rb").readline() == b"@01 1 01 OK IDLE WR 6400\r\n"
    finally:
        server.close()
    assert threading.active_count() < before
