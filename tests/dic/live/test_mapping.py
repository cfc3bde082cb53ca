"""The expanded map of a calibration follows the exact one, also of points that move far."""

import numpy as np
import pytest

from dic.live.mapping import CalibratedArea, LocalMap
from tests.dic.live.rendered_frames import RenderedCamera


@pytest.fixture(scope="module")
def calibration():
    return RenderedCamera(tilt_deg=30.0).calibration


@pytest.mark.parametrize("model", ["bicubic", "pinhole"])
def test_places_and_scales_are_those_of_the_exact_map(calibration, model):
    exact = calibration.using(model)
    px = np.random.default_rng(1).uniform(120, 280, (20, 2))
    local = LocalMap(exact, px)
    for k in range(12):
        moved = px + np.array([1.7 * k, -0.9 * k])
        (mm, scale), (true_mm, true_scale) = local.at(moved), exact.map_and_jacobian(moved)
        np.testing.assert_allclose(mm, true_mm, atol=1e-5 * calibration.mm_per_px)
        np.testing.assert_allclose(scale, true_scale, rtol=1e-4, atol=1e-7)


def test_the_calibrated_area_is_judged_anew_before_a_point_can_cross_its_edge(calibration, monkeypatch):
    area, px = CalibratedArea(calibration), np.array([[200.0, 200.0], [200.0, 320.0]])
    calls, exact = [], type(calibration).inside
    monkeypatch.setattr(type(calibration), "inside", lambda self, px: calls.append(1) or exact(self, px))
    for k in range(120):
        moved = px + np.array([0.0, 0.7 * k])
        np.testing.assert_array_equal(area.inside(moved), exact(calibration, moved))
    assert not area.inside(moved).all()
    assert len(calls) < 60
