"""Commands, questions and refusals while a Zaber stage is opened."""

from dataclasses import replace

import pytest

from drivers.errors import DeviceFault, DeviceTimeout, LinkLost
from drivers.interfaces import OpenContext
from drivers.stages.zaber.protocol import lrc
from drivers.stages.zaber.stage import ZaberStage, open_stage
from tests.drivers.stages.flood import flood
from tests.drivers.stages.stage_kit import Answer
from tests.drivers.stages.zaber.zaber_line import answered, settings


def test_limits_and_speed_are_in_the_stage(stage, device):
    assert (device.limit_min, device.limit_max) == (-5 * 6400, 725 * 6400)
    assert device.speed_microsteps_s == pytest.approx(10 * 6400, rel=1e-5)


def test_limits_can_be_moved_anywhere_in_the_right_order(device, line, context):
    for low, high in ((100.0, 110.0), (-20.0, -10.0), (5000.0, 5010.0)):
        open_stage(settings(line.address, angle_min_deg=low, angle_max_deg=high), context).close()
        assert (device.limit_min, device.limit_max) == (low * 6400, high * 6400)


def test_a_setting_that_the_stage_does_not_take_is_refused(line, device, context):
    def ignore(command: str, answer: Answer) -> bytes:
        speed = device.speed_microsteps_s
        reply = answer()
        device.speed_microsteps_s = speed
        return reply

    line.tamper = ignore
    with pytest.raises(DeviceFault, match="set maxspeed: expected 104858, got 209715 on reading back"):
        open_stage(settings(line.address), context)


def test_a_limit_that_is_no_number_is_told(line, context):
    def two_axes(command: str, answer: Answer) -> bytes:
        reply = answer()
        if command != "get limit.min":
            return reply
        body = reply.decode().partition(":")[0] + " NA"
        return f"{body}:{lrc(body[1:])}\r\n".encode()

    line.tamper = two_axes
    with pytest.raises(DeviceFault, match=r"read limit\.min: expected a whole number, got '-23040000 NA'"):
        open_stage(settings(line.address), context)


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


@pytest.mark.parametrize("reason", ["AGAIN", "STATUSBUSY", "REMOTE"])
def test_a_scale_that_the_stage_does_not_tell_just_now_is_not_taken_for_right(line, context, reason):
    line.tamper = lambda command, answer: (
        answered(answer(), f"RJ IDLE WR {reason}") if "cycle" in command else answer()
    )
    with pytest.raises(DeviceFault, match=f"limit.cycle.dist: expected acceptance, got rejection {reason}"):
        open_stage(settings(line.address, microsteps_per_deg=3200.0), context)


def test_a_stage_that_does_not_know_its_turn_is_believed(line, context):
    def unknown(command: str, answer: Answer) -> bytes:
        if command != "get limit.cycle.dist":
            return answer()
        body = answer().decode()[1:].partition(" OK")[0] + " RJ IDLE WR BADCOMMAND"
        return f"@{body}:{lrc(body)}\r\n".encode()

    line.tamper = unknown
    stage = open_stage(settings(line.address), context)
    assert not stage.read().homed
    stage.close()


def test_a_port_that_does_not_exist_is_told(context):
    with pytest.raises(LinkLost, match="open port: expected a free serial port"):
        open_stage(settings("/dev/ttyNone"), context)


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


def test_a_simulated_name_without_a_simulated_rig_is_told(context):
    with pytest.raises(LinkLost, match="no simulated rig"):
        open_stage(settings("@stage"), context)


def test_a_simulated_rigs_stage_is_found_by_name_and_marked(line, clock):
    class Environment:
        addresses = {"stage": line.address}  # noqa: RUF012

    stage = open_stage(settings("@stage"), OpenContext("stage", clock, Environment()))
    assert stage.info.simulated
    stage.close()


def test_a_stage_whose_answers_all_come_late_is_reported(line, context):
    answers = [b""]

    def late(command: str, answer: Answer) -> bytes:
        answers.append(answer())
        return answers[-2]

    line.tamper = late
    with pytest.raises(
        DeviceTimeout, match=r"'get deviceid': expected an answer within 0\.05 s, got silence"
    ):
        open_stage(settings(line.address, reply_timeout_s=0.05), replace(context, call_timeout_s=60.0))
