"""Tests of `GuardedStage`: a motion is sent once, a stop is confirmed, and a lost link is reported."""

import socket
import struct
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import pytest

from drivers.errors import DeviceFault, DeviceTimeout, LinkLost
from drivers.lines.stop_deadline import StopTimes
from simulators.stage.zaber_settings import ZaberDeviceSettings
from simulators.wire.ports import LOCALHOST
from tests.drivers.stages.esp301.esp301_line import ESP301
from tests.drivers.stages.stage_kit import arrive, stops_end_soon
from tests.drivers.stages.zaber.zaber_line import ZABER


def for_each(names: str, zaber: tuple[object, ...], esp301: tuple[object, ...]) -> pytest.MarkDecorator:
    """Return a mark that repeats the test for each driver, with the driver's own values for `names`."""
    kits = [pytest.param(ZABER, *zaber, id="zaber"), pytest.param(ESP301, *esp301, id="esp301")]
    return pytest.mark.parametrize(f"kit, {names}".split(", "), kits)


@for_each("sent", zaber=("move abs 576000",), esp301=("1PA90.00000",))
def test_homing_in_motion_is_refused(homed, line, clock, sent):
    homed.move_to(90.0)
    clock.sleep(1.0)
    with pytest.raises(DeviceFault, match="home: expected a standing stage, got a stage in motion"):
        homed.home()
    assert line.motions() == [sent]


@for_each(
    "sent, got",
    zaber=("move abs 288000", "silence to the command, and a stage that stands still"),
    esp301=("1PA45.00000", "a stage that stands still"),
)
def test_a_move_that_never_arrived_is_reported_not_repeated(homed, line, device, sent, got):
    line.tamper = lambda command, answer: b"" if command == sent else answer()
    with pytest.raises(DeviceTimeout, match=f"expected a motion, got {got}"):
        homed.move_to(45.0)
    assert line.motions() == [sent]
    assert device.position == 0


@for_each("begins", zaber=("_begin",), esp301=("_confirm_start",))
def test_a_home_search_that_was_stopped_before_it_was_known_to_have_begun_is_told(homed, monkeypatch, begins):
    begin = getattr(homed, begins)

    def begin_and_be_stopped(*given: object) -> None:
        begin(*given)
        homed.stop()

    monkeypatch.setattr(homed, begins, begin_and_be_stopped)
    with pytest.raises(DeviceFault, match="no stop meanwhile"):
        homed.home()
    assert not homed.read().homed


@stops_end_soon
def test_a_stop_that_is_never_confirmed_calls_for_the_emergency_stop(homed, line):
    line.tamper = lambda command, answer: b""
    with pytest.raises(DeviceTimeout, match="press the emergency stop"):
        homed.stop()


@for_each("stop, asks", zaber=("stop", "stop"), esp301=("1ST", "1MD?"))
def test_a_stop_is_repeated_however_long_the_rig_file_lets_answers_take(kit, line, context, stop, asks):
    stage = kit.open(context, line.address, StopTimes(answer_s=0.1), reply_timeout_s=60.0)
    lost = iter([True])
    line.tamper = lambda command, answer: b"" if command == asks and next(lost, False) else answer()
    with ThreadPoolExecutor(1) as pool:
        # long before the answer to the first question is overdue
        pool.submit(stage.stop).result(60.0)
    assert line.received.count(stop) >= 2
    stage.close()


def test_a_mute_device_is_a_timeout(kit, line, context):
    line.tamper = lambda command, answer: b""
    with pytest.raises(DeviceTimeout, match=r"expected an answer within 0\.05 s, got silence"):
        kit.open(context, line.address, reply_timeout_s=0.05)


def test_a_port_in_use_is_told(kit, stage, line, context):
    with pytest.raises(LinkLost, match="no other program"):
        kit.open(context, line.address)


def test_a_lost_link_is_told_by_every_call(homed, line):
    line.close()
    for call in (homed.read, homed.home, lambda: homed.move_to(1.0)):
        with pytest.raises(LinkLost, match="check the cable"):
            call()
    # nobody knows whether it still moves
    with pytest.raises(LinkLost, match="press the emergency stop"):
        homed.stop()


def test_a_stage_whose_link_was_cut_in_motion_is_stopped_over_a_new_one(kit, device, clock, context):
    wire = kit.tcp_server(device, clock)
    stage = kit.open(context, f"socket://{wire.address}")
    stage.home()
    arrive(stage, clock)
    stage.move_to(90.0)
    clock.sleep(1.0)
    wire.drop_clients()
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


def test_a_stop_is_repeated_while_new_links_break_too(kit, device, clock, context):
    """The relay of a guardian that was just killed still accepts connections, which then break."""
    wire = kit.tcp_server(device, clock)
    with socket.socket() as relay, ThreadPoolExecutor(1) as pool:
        relay.bind((LOCALHOST, 0))
        address = "{}:{}".format(*relay.getsockname())
        stage = kit.open(replace(context, relay=address), f"socket://{wire.address}")
        stage.home()
        arrive(stage, clock)
        stage.move_to(90.0)
        clock.sleep(1.0)
        relay.settimeout(10.0)
        relay.listen()
        broken = pool.submit(break_links, relay, 3)
        wire.drop_clients()
        stage.stop()
        broken.result(60.0)
    assert not device.moving
    stage.close()
    wire.close()


def break_links(relay: socket.socket, number: int) -> None:
    for _ in range(number):
        link, _ = relay.accept()
        # closed with a reset, as by a process that was killed
        link.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        link.close()
    relay.close()


@for_each(
    "identity, another",
    zaber=("settings", lambda device: ZaberDeviceSettings(device, 1, 7777)),
    esp301=("_serial", lambda device: 7777),
)
def test_another_stage_where_ours_was_is_not_ours_standing_still(
    kit, device, clock, context, identity, another
):
    wire = kit.tcp_server(device, clock)
    stage = kit.open(context, f"socket://{wire.address}", StopTimes(deadline_s=0.3))
    wire.drop_clients()
    setattr(wire, identity, another(device))
    with pytest.raises(DeviceTimeout, match=r"expected standstill, got .*7777.*press the emergency stop"):
        stage.stop()
    stage.close()
    wire.close()
