"""Simulated stages at pseudo-terminals are found by the identity that they report, and nothing moves."""

from contextlib import closing

from drivers.clock import VirtualClock
from drivers.registry import Found
from drivers.stages.esp301.find import newport_stages
from drivers.stages.zaber.find import zaber_stages
from simulators.stage.device import StageDevice
from simulators.stage.newport import NewportServer
from simulators.stage.zaber import ZaberServer


def test_a_zaber_stage_is_found_with_its_address_and_does_not_move():
    clock = VirtualClock()
    stage = StageDevice(clock)
    with closing(ZaberServer(stage, device_address=3, serial=4711)) as server:
        found = zaber_stages(server.address)
        assert newport_stages(server.address) == []
    settings = {"port": server.address, "address": 3}
    assert found == [Found("Zaber device 3, serial number 4711", settings)]
    clock.sleep(10.0)
    assert stage.position == 0


def test_a_newport_stage_is_found_with_its_rate_and_does_not_move():
    clock = VirtualClock()
    stage = StageDevice(clock)
    with closing(NewportServer(stage, clock)) as server:
        (found,) = newport_stages(server.address)
        assert zaber_stages(server.address) == []
    assert found.what.startswith("Newport ESP301, firmware ")
    assert found.settings == {"port": server.address, "baud": 921_600}
    clock.sleep(10.0)
    assert stage.position == 0
