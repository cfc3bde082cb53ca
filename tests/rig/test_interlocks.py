"""Interlocks on the virtual rig: an open one refuses the start, and ends a run in the safe state."""

import pytest

from drivers.errors import ConfigurationError
from rig import run_protocol
from rig.errors import InterlockOpen
from rig.rigfile import read_rig
from simulators.rig.virtual_rig import VirtualRig
from tests.places import example

DOOR = """
[interlocks.door]
driver = "modbus-input"
address = "@interlocks"
number = 2
allowed_min = 1
"""
OVEN = """
[interlocks.oven]
driver = "modbus-input"
address = "@interlocks"
table = "input"
number = 0
scale = 0.1
quantity = "°C"
allowed_max = 40
"""


@pytest.fixture
def rigs(monkeypatch) -> list[VirtualRig]:
    """The virtual rigs that were opened; `on_open` of the list's owner may prepare them."""
    opened: list[VirtualRig] = []
    build = VirtualRig.__init__

    def built(rig: VirtualRig, *args, **kwargs) -> None:
        build(rig, *args, **kwargs)
        opened.append(rig)

    monkeypatch.setattr(VirtualRig, "__init__", built)
    return opened


@pytest.fixture
def files(tmp_path):
    small = ('driver = "simulated-camera"', 'driver = "simulated-camera"\nwidth_px = 64\nheight_px = 64')
    (tmp_path / "p.toml").write_text(example("tension"))
    (tmp_path / "r.toml").write_text(example("rig-virtual-tension").replace(*small) + DOOR + OVEN)
    return tmp_path / "p.toml", tmp_path / "r.toml", tmp_path / "run.h5"


def test_an_open_interlock_refuses_the_start_by_its_name(files, monkeypatch):
    build = VirtualRig.__init__

    def with_an_open_door(rig: VirtualRig, *args, **kwargs) -> None:
        build(rig, *args, **kwargs)
        rig.interlocks.set_contact(2, closed=False)

    monkeypatch.setattr(VirtualRig, "__init__", with_an_open_door)
    with pytest.raises(InterlockOpen, match="before the start: expected interlock door at least 1, got 0"):
        run_protocol(*files)
    assert not files[2].exists()


@pytest.mark.parametrize(
    ("happens", "said"),
    [
        (lambda module: module.set_contact(2, closed=False), "expected interlock door at least 1, got 0"),
        (lambda module: module.set_register(0, 401), "expected interlock oven at most 40 °C, got 40.1 °C"),
    ],
)
def test_an_interlock_that_opens_during_a_motion_ends_the_run_in_the_safe_state(files, rigs, happens, said):
    def on_progress(_may_move: bool) -> None:
        if rigs[0].load_frame.load_n() > 700.0:
            happens(rigs[0].interlocks)

    outcome = run_protocol(*files, on_progress=on_progress)
    assert outcome.status == "failed"
    assert said in outcome.reason
    assert outcome.unsafe == ()
    assert rigs[0].load_frame.executed[-1][1] == "hold"
    assert rigs[0].load_frame.load_n() < 800.0


def test_an_interlock_without_a_condition_is_a_mistake_in_the_rig_file(files):
    text = files[1].read_text().replace("allowed_min = 1\n", "")
    files[1].write_text(text)
    with pytest.raises(ConfigurationError, match=r"interlocks\.door: allowed_min or allowed_max is expected"):
        read_rig(files[1])
