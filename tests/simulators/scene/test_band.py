"""A Lüders band travels along the sheet: the load is that of the plateau, and each place yields in turn."""

from dataclasses import replace
from math import log

import numpy as np
import pytest
from pydantic import ValidationError

from simulators.rig.virtual_rig import VirtualRig, VirtualRigSettings
from simulators.scene.optics import PinholeCamera
from simulators.scene.pose import Pose
from simulators.scene.scene import Misalignment, Scene, Surface
from simulators.scene.specimen import SimulatedSpecimen, SpecimenSettings
from simulators.scene.texture import LineGrid

LENGTH_MM, PLATEAU, DROP, WIDTH_MM = 60.0, 0.015, 0.002, 4.0
POINT = {"upper_mpa": 400.0, "lower_mpa": 375.0, "plateau_strain": PLATEAU, "drop_strain": DROP}
STEEL = {
    "youngs_modulus_mpa": 205_000.0,
    "poisson_ratio": 0.29,
    "strain_ratio": 1.6,
    "fracture_strain": 0.4,
    "grip_slip_mm": 0.0,
    "hardening": {"law": "swift", "strength_mpa": 780.0, "offset_strain": 0.004, "exponent": 0.18},
}
POINTS_MM = np.stack(np.meshgrid([-12.0, 0.0, 7.0], np.linspace(-29.0, 29.0, 117)), axis=-1).reshape(-1, 2)


def banded(**band):
    point = POINT | {"band": {"front_width_mm": WIDTH_MM} | band}
    return SpecimenSettings.model_validate(STEEL | {"yield_point": point})


def states(made, step_mm=0.005, until_mm=2.4):
    specimen = SimulatedSpecimen(made)
    for displacement_mm in np.arange(0.0, until_mm, step_mm):
        specimen.stretch_to(displacement_mm)
        yield specimen.state


def on_the_plateau(made, displacement_mm=1.2):
    specimen = SimulatedSpecimen(made)
    specimen.stretch_to(displacement_mm)
    assert specimen.state.band is not None
    return specimen.state


def surface_of(specimen):
    scene = Scene(
        seed=1,
        misalignment=Misalignment(),
        specimen=specimen,
        angle_deg=lambda: 0.0,
        load_n=lambda: specimen.state.load_n,
    )
    return scene.surface()


@pytest.mark.parametrize("start", ["lower", "upper"])
def test_a_gauge_sees_nothing_then_the_strain_of_the_plateau_then_nothing(start):
    strains, fronts = [], []
    for state in states(banded(start=start)):
        if state.band is not None and state.load_n == pytest.approx(375.0 * 25, rel=1e-9):
            strains.append(state.band.strain_between(-6.0, 6.0))
            fronts.append(state.band.front_mm)
    strains, fronts = np.array(strains), np.array(fronts) * (1 if start == "lower" else -1)
    elastic = 375.0 / 205_000.0
    np.testing.assert_allclose(strains[fronts < -6.0 - WIDTH_MM / 2], elastic, rtol=1e-12)
    np.testing.assert_allclose(strains[fronts > 6.0 + WIDTH_MM / 2], elastic + PLATEAU, rtol=1e-12)
    within = (fronts > -4.0) & (fronts < 4.0)
    np.testing.assert_allclose(strains[within], elastic + PLATEAU * (fronts[within] + 6.0) / 12.0, rtol=1e-12)
    # the front travels steadily: the crosshead's way over the strain of the plateau
    middle = np.abs(fronts) < 20.0
    np.testing.assert_allclose(np.diff(fronts[middle]), 0.005 / PLATEAU, rtol=1e-6)


def test_the_load_is_that_of_a_sheet_that_yields_everywhere_alike():
    plain = SpecimenSettings.model_validate(STEEL | {"yield_point": POINT})
    for state, alike in zip(states(banded()), states(plain), strict=True):
        assert replace(state, band=None) == alike


def test_the_mean_strain_and_the_way_of_the_ends_are_those_of_the_sheet():
    specimen = SimulatedSpecimen(banded())
    travels = 0
    for displacement_mm in np.arange(0.0, 2.0, 0.01):
        specimen.stretch_to(displacement_mm)
        half_mm = LENGTH_MM / 2
        low, high = surface_of(specimen).world(np.array([[0.0, -half_mm], [0.0, half_mm]]))[:, 1]
        longer_mm = specimen.state.axial_strain * LENGTH_MM
        assert high - low - LENGTH_MM == pytest.approx(longer_mm, abs=1e-12)
        assert high + low == pytest.approx(0.0, abs=1e-12)
        if (band := specimen.state.band) is not None:
            travels += 1
            assert band.strain_between(-half_mm, half_mm) == pytest.approx(longer_mm / LENGTH_MM, abs=1e-14)
    assert travels > 70


def test_no_place_jumps_when_the_band_comes_and_goes():
    """The last picture of the band and the first one after it differ by the motion of the crosshead only."""
    specimen = SimulatedSpecimen(banded())
    before, seen = None, set()
    for displacement_mm in np.arange(0.0, 2.0, 0.002):
        specimen.stretch_to(displacement_mm)
        seen.add(specimen.state.band is None)
        places = surface_of(specimen).world(POINTS_MM)
        if before is not None:
            # at the end where it begins, the front is fast at first
            assert np.max(np.abs(places - before)) < 0.02
        before = places
    assert seen == {True, False}


@pytest.mark.parametrize("start", ["lower", "upper"])
def test_each_ray_meets_the_material_point_that_was_projected(start):
    specimen = SimulatedSpecimen(banded(start=start))
    specimen.stretch_to(1.3)
    surface = replace(surface_of(specimen), pose=Pose.sloped(1.0, -2.0, 0.3))
    camera = PinholeCamera(900, 900, pan_deg=30.0)
    px = camera.project(surface.world(POINTS_MM))
    np.testing.assert_allclose(surface.material(*camera.ray(px)), POINTS_MM, atol=1e-11)


def test_the_strain_at_each_place_keeps_the_plastic_volume():
    state = on_the_plateau(banded())
    band, h = state.band, 1e-5
    surface = Surface(LineGrid(), deformation_gradient=band.elastic_gradient, band=band)
    for y_mm in np.linspace(band.front_mm - 4.0, band.front_mm + 4.0, 33):
        at = np.array([[0.0, y_mm - h], [0.0, y_mm + h], [1.0, y_mm], [0.0, y_mm]])
        below, above, aside, here = surface.world(at)[:, :2]
        along = (above - below)[1] / (2 * h) - 1.0
        across = (aside - here)[0] - 1.0
        plastic = float(band.plastic_at(y_mm))
        assert along == pytest.approx(band.elastic + plastic, abs=1e-9)
        assert along == pytest.approx(band.strain_at(y_mm), abs=1e-9)
        width = log(across + 1.0 + 0.29 * band.elastic)
        # r = 1.6: the width takes 1.6 / 2.6 of the true plastic strain
        assert width == pytest.approx(-1.6 / 2.6 * log(1.0 + plastic), abs=1e-9)
    assert plastic == 0.0


def test_an_unloaded_sheet_keeps_its_band_and_goes_on_from_there():
    specimen = SimulatedSpecimen(banded())
    specimen.stretch_to(1.2)
    front_mm = specimen.state.band.front_mm
    specimen.stretch_to(1.0)
    assert specimen.state.band.front_mm == front_mm
    assert specimen.state.band.elastic < 375.0 / 205_000.0
    specimen.stretch_to(1.3)
    assert specimen.state.band.front_mm > front_mm + 3.0


def test_a_virtual_rig_tells_the_truth_about_its_band():
    rig = VirtualRig(VirtualRigSettings(specimen=banded()))
    try:
        assert rig.truth()["band_travels"] is False
        ends_mm = LENGTH_MM / 2 + WIDTH_MM / 2
        assert rig.truth()["band_front_mm"] == pytest.approx(-ends_mm)
        rig.load_frame.go_to_displacement(1.2, 0.1)
        rig.clock.sleep(15.0)
        truth, surface = rig.truth(), rig.scene.surface()
        assert truth["band_travels"]
        assert truth["band_front_mm"] == surface.band.front_mm
        assert truth["middle_strain"] == pytest.approx(surface.band.strain_at(0.0))
        rig.load_frame.go_to_displacement(3.0, 0.1)
        rig.clock.sleep(30.0)
        truth = rig.truth()
        assert (truth["band_travels"], truth["middle_strain"]) == (False, truth["axial_strain"])
        assert truth["band_front_mm"] == pytest.approx(ends_mm, abs=1e-3)
    finally:
        rig.close()


def test_a_sheet_without_a_band_has_no_front():
    specimen = SimulatedSpecimen(SpecimenSettings())
    with pytest.raises(ValueError, match="has no front"):
        specimen.front_mm()


@pytest.mark.parametrize("band", [{"front_width_mm": 0.0}, {"start": "middle"}, {"speed": 1.0}])
def test_a_band_that_cannot_be_is_refused(band):
    with pytest.raises(ValidationError):
        banded(**band)
