"""A Zaber stage moves once for each command within its limits, and a missing motion is reported."""

import pytest

from drivers.errors import DeviceFault
from drivers.stages.zaber.stage import open_stage
from simulators.stage.zaber import ZaberServer
from tests.drivers.stages.stage_kit import Answer, arrive, untampered
from tests.drivers.stages.zaber.zaber_line import lose, settings
from tests.tcp_servers import zaber_on_tcp


@pytest.mark.parametrize(("server", "url"), [(ZaberServer, "{}"), (zaber_on_tcp, "socket://{}")])
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


@pytest.mark.parametrize("angle_deg", [-5.1, 725.1, float("nan"), float("inf")])
def test_angles_out_of_limits_are_refused_before_anything_is_sent(homed, line, angle_deg):
    with pytest.raises(DeviceFault, match="from -5° to 725°"):
        homed.move_to(angle_deg)
    assert line.received == []


def test_the_stages_own_rejection_is_told(homed, device):
    device.limit_max = 10 * 6400
    with pytest.raises(DeviceFault, match=r"BADDATA .*out of range"):
        homed.move_to(20.0)


def test_motion_without_a_reference_is_refused(stage, line):
    with pytest.raises(DeviceFault, match="home the stage first"):
        stage.move_to(10.0)
    assert line.motions() == []


def test_a_second_move_while_moving_is_refused(homed):
    homed.move_to(90.0)
    with pytest.raises(DeviceFault, match="a stage in motion"):
        homed.move_to(10.0)


def test_an_interruption_warns_and_the_next_move_starts_clean(homed, device, clock):
    homed.move_to(90.0)
    clock.sleep(1.0)
    homed.stop()
    assert homed.read().warnings == ("NI",)
    homed.move_to(10.0)
    assert arrive(homed, clock) == 10.0
    assert homed.read().warnings == ()


def test_a_fault_that_strikes_at_the_start_is_told_and_not_called_silence(homed, line, device):
    def stall(command: str, answer: Answer) -> bytes:
        reply = answer()
        if not command.startswith("move"):
            return reply
        device.fail("FS")
        return b""

    line.tamper = stall
    with pytest.raises(DeviceFault, match="the stage stalled"):
        homed.move_to(45.0)


def test_a_move_whose_answer_is_lost_is_never_sent_again(homed, line, device, clock):
    line.tamper = lose("move abs")
    homed.move_to(45.0)
    assert line.motions() == ["move abs 288000"]
    line.tamper = untampered
    assert arrive(homed, clock) == 45.0


def test_a_move_that_ended_before_its_answer_was_missed_is_done(homed, line, clock):
    def lose_and_arrive(command: str, answer: Answer) -> bytes:
        reply = answer()
        if not command.startswith("move"):
            return reply
        clock.sleep(60.0)
        return b""

    line.tamper = lose_and_arrive
    homed.move_to(45.0)
    assert line.motions() == ["move abs 288000"]
    assert homed.read().angle_deg == 45.0


def test_a_damaged_answer_to_a_move_counts_as_lost(homed, line, clock):
    line.tamper = lambda command, answer: (
        answer().replace(b"OK", b"OX") if command.startswith("move") else answer()
    )
    homed.move_to(45.0)
    assert len(line.motions()) == 1
    assert arrive(homed, clock) == 45.0
