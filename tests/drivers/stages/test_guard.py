"""With every driver, the guard of a stage passes the driver's messages on, and can stop the stage alone."""

from collections.abc import Iterator
from dataclasses import replace

import pytest

from drivers.errors import DeviceError, DeviceTimeout, LinkLost
from drivers.interfaces import OpenContext, RotationStage
from drivers.registry import Guard, find_driver
from simulators.stage.device import StageDevice
from tests.drivers.stages.stage_kit import StageKit, arrive

NAMES = {"ZaberSettings": "zaber-ascii", "EspSettings": "newport-esp301"}


@pytest.fixture(params=["pty", "tcp"])
def address(request, kit: StageKit, device: StageDevice, clock) -> Iterator[str]:
    server = kit.line(device, clock) if request.param == "pty" else kit.tcp_server(device, clock)
    yield server.address if request.param == "pty" else f"socket://{server.address.rpartition('//')[2]}"
    server.close()


@pytest.fixture
def guard(kit: StageKit, address: str, context: OpenContext) -> Iterator[Guard]:
    settings = kit.settings(address)
    spec = find_driver(NAMES[type(settings).__name__]).guard
    assert spec is not None
    opened = spec.open(settings, context)
    yield opened
    opened.close()
    opened.close()


@pytest.fixture
def guarded(guard: Guard, kit: StageKit, address: str, context: OpenContext) -> Iterator[RotationStage]:
    opened = kit.open(replace(context, guarded=True, relay=guard.relay), address, reply_timeout_s=0.5)
    yield opened
    opened.close()


def test_the_driver_works_through_the_guard_and_names_the_real_port(guarded, guard, clock, address):
    guarded.home()
    arrive(guarded, clock)
    guarded.move_to(30.0)
    assert arrive(guarded, clock) == pytest.approx(30.0, abs=0.01)
    guard.check()
    with pytest.raises(DeviceError, match=address):
        guarded.move_to(1e5)


def test_the_guard_stops_a_motion_that_the_driver_began(guarded, guard, device, clock):
    guarded.home()
    arrive(guarded, clock)
    guarded.move_to(300.0)
    clock.sleep(2.0)
    assert device.moving
    guard.stop()
    assert not device.moving
    guard.stop()


def test_after_the_guards_stop_the_driver_commands_nothing_more(guarded, guard, device, clock):
    guarded.home()
    arrive(guarded, clock)
    guard.stop()
    with pytest.raises(LinkLost):
        guarded.move_to(90.0)
    assert not device.moving


def test_once_the_guard_is_gone_the_drivers_stop_opens_the_line_itself(guarded, guard, device, clock):
    guarded.home()
    arrive(guarded, clock)
    guarded.move_to(300.0)
    clock.sleep(2.0)
    guard.close()
    assert device.moving
    guarded.stop()
    assert not device.moving


def test_a_guard_of_a_silent_line_is_refused(kit: StageKit, device, clock, context):
    server = kit.line(device, clock)
    settings = kit.settings(server.address, reply_timeout_s=0.1)
    server.tamper = lambda command, answer: b""
    with pytest.raises(DeviceTimeout):
        find_driver(NAMES[type(settings).__name__]).guard.open(settings, context)
    server.close()


def test_a_missing_port_is_one_sentence(kit: StageKit, tmp_path, context):
    settings = kit.settings(str(tmp_path / "none"))
    with pytest.raises(LinkLost, match="open port for the guardian: expected a free serial port"):
        find_driver(NAMES[type(settings).__name__]).guard.open(settings, context)
