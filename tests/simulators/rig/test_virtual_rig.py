import socket
import stat
import threading
from pathlib import Path

import numpy as np
import pytest

from drivers.clock import VirtualClock
from drivers.errors import DeviceError
from drivers.interfaces import OpenContext, OperatorAction, OperatorQuestion
from drivers.registry import find_driver
from rig.rigfile import read_rig
from simulators.rig.camera import SPEC as CAMERA
from simulators.rig.operator import SPEC as OPERATOR, OperatorSettings
from simulators.rig.virtual_rig import SPEC, VirtualRigSettings
from simulators.scene.texture import LineGrid
from tests.mistakes import mistakes_of
from tests.places import EXAMPLES


@pytest.fixture
def open_rig():
    opened = []

    def open_one(**settings):
        context = OpenContext("simulation", VirtualClock())
        opened.append(SPEC.open(VirtualRigSettings.model_validate(settings), context))
        return opened[-1]

    yield open_one
    for rig in opened:
        rig.close()


def picture(rig):
    context = OpenContext("on_axis", rig.clock, rig)
    return CAMERA.open(CAMERA.settings(width_px=60, height_px=60), context).grab(1.0).image


def test_stage_and_frame_are_on_the_wire(open_rig):
    rig = open_rig()
    assert stat.S_ISCHR(Path(rig.addresses["stage"]).stat().st_mode)
    host, port = rig.addresses["load_frame"].split(":")
    socket.create_connection((host, int(port)), timeout=5).close()


def test_closing_ends_its_servers(open_rig):
    before = threading.active_count()
    rig = open_rig()
    host, port = rig.addresses["load_frame"].split(":")
    assert threading.active_count() > before
    rig.close()
    rig.close()
    assert threading.active_count() == before
    with pytest.raises(ConnectionRefusedError):
        socket.create_connection((host, int(port)), timeout=5)


@pytest.mark.parametrize("device", ["stage", "newport"])
def test_an_emergency_stop_ends_the_shafts_motion_whatever_controller_is_asked(open_rig, device):
    rig = open_rig()
    rig.stage.move_to(640_000)
    rig.faults.switch_on(f"{device}.e-stop")
    assert not rig.stage.moving


def test_an_emergency_stop_ends_the_crossheads_motion(open_rig):
    rig = open_rig()
    rig.load_frame.go_to_displacement(2.0, 1.0)
    rig.clock.sleep(0.1)
    rig.faults.switch_on("load_frame.e-stop")
    rig.clock.sleep(10.0)
    assert 0.0 < rig.load_frame.displacement_mm() < 0.2


def test_the_truth_is_hookes_while_the_load_is_small(open_rig):
    rig = open_rig()
    rig.load_frame.go_to_load(1000.0, 500.0)
    rig.clock.sleep(10.0)
    truth = rig.truth()
    assert truth["load_n"] == pytest.approx(1000.0, abs=1.0)
    # 25 mm² of 73.1 GPa, and Poisson's ratio of 0.33
    assert truth["axial_strain"] == pytest.approx(1000.0 / (25.0 * 73_100.0), rel=2e-3)
    assert truth["transverse_strain"] == pytest.approx(-0.33 * 1000.0 / (25.0 * 73_100.0), rel=2e-3)


def test_the_seed_decides_what_the_load_cell_says(open_rig):
    said = [[open_rig(seed=seed).load_frame.read().load_n for _ in range(2)] for seed in (5, 5, 6)]
    assert said[0] == said[1] != said[2]


def test_the_seed_decides_every_pixel(open_rig):
    np.testing.assert_array_equal(picture(open_rig(seed=5)), picture(open_rig(seed=5)))
    assert np.any(picture(open_rig(seed=5)) != picture(open_rig(seed=6)))


def test_the_operator_attaches_and_removes_the_grid_in_his_own_time(open_rig):
    rig = open_rig()
    operator = OPERATOR.open(OperatorSettings(duration_s=30.0), OpenContext("operator", rig.clock, rig))
    operator.perform(OperatorAction.ATTACH_GRID)
    assert isinstance(rig.scene.surface().texture, LineGrid)
    operator.perform(OperatorAction.REMOVE_GRID)
    assert not isinstance(rig.scene.surface().texture, LineGrid)
    operator.ask(OperatorQuestion("Please take the extensometer off.", "off"))
    assert not isinstance(rig.scene.surface().texture, LineGrid)
    assert rig.clock.now_s() == 90.0


def test_the_operator_needs_a_virtual_rig():
    with pytest.raises(DeviceError, match="expected the scene of a virtual rig"):
        OPERATOR.open(OperatorSettings(), OpenContext("operator", VirtualClock()))


def test_it_is_found_by_its_name():
    assert find_driver("virtual-rig") is SPEC
    assert find_driver("simulated-operator") is OPERATOR


def test_mistakes_in_any_of_its_tables_are_reported_together():
    table = {"sed": 1, "misalignment": {"axis_slope_x_deg": 9.0}, "specimen": {"width": 25.0}}
    assert len(mistakes_of(VirtualRigSettings, table)) == 3


@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("rig-virtual-*.toml")), ids=lambda path: path.stem)
def test_the_examples_are_rigs(path):
    rig = read_rig(path)
    if rig.measured_load is None:
        assert list(rig.cameras) == ["on_axis", "off_axis"]
        assert (rig.stage is None) != (rig.load_frame is None)
    assert rig.simulation is not None
    assert isinstance(rig.simulation.settings, VirtualRigSettings)


def test_a_load_cell_shows_its_error_and_the_truth_does_not(open_rig):
    rig = open_rig(load_cell={"error_percent": 1.0, "noise_n": 0.0})
    rig.load_frame.go_to_displacement(1.0, 1.0)
    rig.clock.sleep(2.0)
    true_n = rig.truth()["load_n"]
    assert true_n > 1000.0
    assert rig.load_frame.read().load_n == pytest.approx(1.01 * true_n, rel=1e-12)


def test_the_surface_recedes_as_the_sheet_becomes_thinner(open_rig):
    rig = open_rig(specimen={"thickness_mm": 2.0, "resting_depth": 0.5})
    assert rig.scene.surface().pose.translation_mm[2] == 0.0
    rig.load_frame.go_to_displacement(4.0, 1.0)
    rig.clock.sleep(6.0)
    lost_mm = -2.0 * rig.truth()["thickness_strain"]
    assert lost_mm > 0.03
    assert rig.scene.surface().pose.translation_mm[2] == pytest.approx(-0.5 * lost_mm, rel=1e-12)


def test_the_exact_properties_are_those_of_the_settings(open_rig):
    rig = open_rig(specimen={"youngs_modulus_mpa": 70_000.0, "strain_ratio": 0.8})
    assert (rig.exact_properties["E_gpa"], rig.exact_properties["r"]) == (70.0, 0.8)
