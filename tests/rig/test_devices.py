import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

import pytest

from drivers.clock import SystemClock, VirtualClock
from drivers.errors import DeviceError, DeviceTimeout, LinkLost
from drivers.interfaces import CameraInfo, OpenContext
from drivers.registry import DriverSpec
from drivers.settings import Settings
from rig.devices import open_rig
from rig.rigfile import DeviceEntry, RigFile


@dataclass
class Opened:
    name: str
    log: list[str]
    hook: Callable[[str], None]
    clock: VirtualClock = field(default_factory=VirtualClock)
    info: CameraInfo = field(default_factory=lambda: CameraInfo("maker", "model", "1"))

    def close(self) -> None:
        self.hook(f"close {self.name}")
        self.log.append(f"close {self.name}")


def rig_file(
    log: list[str],
    contexts: dict[str, OpenContext],
    broken: str = "",
    environment: bool = True,
    simulated: bool = False,
    hook: Callable[[str], None] = lambda what: None,
) -> RigFile:
    def entry(name: str) -> DeviceEntry:
        def open_device(settings, context):
            hook(f"open {name}")
            if name == broken:
                raise LinkLost(name, "open", "an answer", "none", "check the cable")
            log.append(f"open {name}")
            contexts[name] = context
            return Opened(name, log, hook)

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


@pytest.fixture
def hang_at() -> Iterator[Callable[[str], Callable[[str], None]]]:
    """A function that makes one opening or closing hang until the end of the test or until `over` is set."""
    over = threading.Event()

    def at(which: str) -> Callable[[str], None]:
        return lambda what: over.wait() and None if what == which else None

    at.over = over
    yield at
    over.set()


def test_device_that_hangs_while_it_is_opened_closes_those_before_it(hang_at):
    log = []
    opening = open_rig(rig_file(log, {}, hook=hang_at("open on_axis")), opening_s=1.0)
    with pytest.raises(DeviceTimeout) as error, opening:
        pass
    assert str(error.value).startswith("on_axis: open: expected an end within 1 s, got none: the call hangs")
    assert log == ["open simulation", "open stage", "close stage", "close simulation"]


def test_device_that_is_opened_too_late_is_closed_again(hang_at):
    log = []
    with (
        pytest.raises(DeviceTimeout),
        open_rig(rig_file(log, {}, hook=hang_at("open on_axis")), opening_s=1.0),
    ):
        pass
    hang_at.over.set()
    for thread in threading.enumerate():
        if thread.name == "on_axis: open":
            thread.join()
    assert log[-2:] == ["open on_axis", "close on_axis"]


def test_device_that_hangs_while_it_is_closed_is_said_and_those_before_it_are_closed(hang_at):
    log = []
    with open_rig(rig_file(log, {}, hook=hang_at("close on_axis")), closing_s=1.0) as rig:
        pass
    assert log[-3:] == ["close operator", "close stage", "close simulation"]
    assert rig.lost_devices == (
        "on_axis: its driver hangs in close, which has not returned for 1 s; the device is not closed",
    )


def test_lost_device_is_not_closed():
    log = []
    with open_rig(rig_file(log, {})) as rig:
        rig.lost["stage"] = "read, which has not returned for 0.7 s"
    assert log[-3:] == ["close operator", "close on_axis", "close simulation"]


@pytest.mark.parametrize(
    "error", [DeviceTimeout("on_axis", "close", "an answer", "none", "x"), ValueError("a bug")]
)
def test_error_of_a_closing_is_an_error_and_no_hang(error):
    def fail(what: str) -> None:
        if what == "close on_axis":
            raise error

    log = []
    with (
        pytest.raises(DeviceError, match=r"^on_axis: close: expected "),
        open_rig(rig_file(log, {}, hook=fail)) as rig,
    ):
        pass
    assert rig.lost == {}
    assert log[-2:] == ["close stage", "close simulation"]


def test_drivers_are_told_the_deadline_of_their_calls():
    contexts: dict[str, OpenContext] = {}
    with open_rig(replace(rig_file([], contexts), call_timeout_s=1.5)):
        pass
    assert contexts["stage"].call_timeout_s == 1.5
    assert contexts["stage"].patience_s == 0.0
