from dataclasses import dataclass, field
from pathlib import Path

import pytest

from drivers.clock import SystemClock, VirtualClock
from drivers.errors import LinkLost
from drivers.interfaces import OpenContext
from drivers.registry import DriverSpec
from drivers.settings import Settings
from rig.devices import open_rig
from rig.rigfile import DeviceEntry, RigFile


@dataclass
class Opened:
    name: str
    log: list[str]
    clock: VirtualClock = field(default_factory=VirtualClock)

    def close(self) -> None:
        self.log.append(f"close {self.name}")


def rig_file(
    log: list[str],
    contexts: dict[str, OpenContext],
    broken: str = "",
    environment: bool = True,
    simulated: bool = False,
) -> RigFile:
    def entry(name: str) -> DeviceEntry:
        def open_device(settings, context):
            if name == broken:
                raise LinkLost(name, "open", "an answer", "none", "check the cable")
            log.append(f"open {name}")
            contexts[name] = context
            return Opened(name, log)

        return DeviceEntry(name, "fake", DriverSpec("camera", Settings, open_device), Settings())

    return RigFile(
        path=Path("rig.toml"),
        text="",
        name="fakes",
        simulated=simulated,
        operator=entry("operator"),
        cameras={"on_axis": entry("on_axis")},
        simulation=entry("simulation") if environment else None,
        stage=entry("stage"),
        load_frame=None,
    )


def test_environment_is_opened_first_and_gives_its_clock_to_all():
    log, contexts = [], {}
    with open_rig(rig_file(log, contexts)) as rig:
        environment = contexts["stage"].environment
        assert environment.name == "simulation"
        assert rig.clock is environment.clock
        assert all(contexts[name].clock is environment.clock for name in ("stage", "on_axis", "operator"))
        assert rig.virtual
    opened = [entry.removeprefix("open ") for entry in log if entry.startswith("open")]
    assert opened[0] == "simulation"
    assert [entry.removeprefix("close ") for entry in log if entry.startswith("close")] == opened[::-1]


def test_real_rig_runs_on_the_systems_clock():
    contexts = {}
    with open_rig(rig_file([], contexts, environment=False)) as rig:
        assert isinstance(rig.clock, SystemClock)
        assert contexts["stage"].environment is None
        assert not rig.virtual


def test_a_rig_file_may_say_that_its_devices_are_simulated():
    with open_rig(rig_file([], {}, environment=False, simulated=True)) as rig:
        assert isinstance(rig.clock, SystemClock)
        assert rig.virtual


def test_device_that_does_not_open_closes_those_before_it():
    log = []
    with pytest.raises(LinkLost), open_rig(rig_file(log, {}, broken="on_axis")):
        pass
    assert log == ["open simulation", "open stage", "close stage", "close simulation"]
