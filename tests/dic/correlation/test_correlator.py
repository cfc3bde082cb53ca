"""Tests of the correlation with images whose motion is known exactly."""

import numpy as np
import pytest
from scipy.ndimage import map_coordinates
from scipy.optimize import least_squares

from dic.correlation.correlator import Correlator
from dic.correlation.settings import CorrelationSettings
from dic.correlation.status import Status
from dic.errors import CorrelationError

SMALL = CorrelationSettings(subset_px=21, step_px=12, shape="affine")


def affine_back(p):
    """Return the inverse motion of x' = x + u + ux x + uy y, y' = y + v + vx x + vy y, as `back`."""
    u, ux, uy, v, vx, vy = p
    inverse = np.linalg.inv([[1 + ux, uy], [vx, 1 + vy]])

    def back(x, y):
        a, b = x - u, y - v
        return inverse[0, 0] * a + inverse[0, 1] * b, inverse[1, 0] * a + inverse[1, 1] * b

    return back


def affine_truth(field, p):
    u, ux, uy, v, vx, vy = p
    x, y = np.meshgrid(field.x_px, field.y_px)
    return u + ux * x + uy * y, v + vx * x + vy * y


@pytest.mark.parametrize(("shape", "order", "tolerance_px"), [("affine", 3, 3e-3), ("quadratic", 5, 1e-3)])
def test_affine_motion_is_found_at_every_point(speckle, shape, order, tolerance_px):
    pattern = speckle(seed=2)
    p = (3.3, 0.01, -0.02, -2.6, 0.015, -0.008)
    settings = CorrelationSettings(subset_px=21, step_px=12, shape=shape, order=order)
    field = Correlator(pattern.draw(), settings=settings).correlate(pattern.draw(affine_back(p)))
    u, v = affine_truth(field, p)
    assert field.converged.sum() == field.in_view > 100
    assert np.nanmax(np.hypot(field.u_px - u, field.v_px - v)) < tolerance_px
    gradients = field.warps[..., [1, 2, 4, 5]]
    assert np.nanmax(np.abs(gradients - np.array(p)[[1, 2, 4, 5]])) < tolerance_px / 5


def test_a_point_is_where_an_independent_minimiser_finds_the_smallest_znssd(speckle):
    pattern = speckle(seed=4, noise=0.5)
    p = np.array([0.4, 0.01, 0.0, -0.3, 0.02, -0.01])
    reference, deformed = pattern.draw(noise_seed=1), pattern.draw(affine_back(p), noise_seed=2)
    field = Correlator(reference, settings=CorrelationSettings(21, 12, "affine", order=3)).correlate(deformed)
    row, column = field.status.shape[0] // 2, field.status.shape[1] // 2
    x, y = field.x_px[column], field.y_px[row]
    dy, dx = np.mgrid[-10:11, -10:11].astype(float)

    def normalised(a):
        return (a - a.mean()) / np.linalg.norm(a - a.mean())

    subset = normalised(reference[y - 10 : y + 11, x - 10 : x + 11].astype(float))

    def residuals(q):
        at_x, at_y = x + dx + q[0] + q[1] * dx + q[2] * dy, y + dy + q[3] + q[4] * dx + q[5] * dy
        seen = map_coordinates(deformed.astype(float), [at_y, at_x], order=3, mode="mirror")
        return (normalised(seen) - subset).ravel()

    best = least_squares(residuals, field.warps[row, column], x_scale=[1, 0.1, 0.1, 1, 0.1, 0.1], xtol=1e-12)
    # The slopes are the reference's here and the deformed image's there: equal but for their noise.
    np.testing.assert_allclose(field.warps[row, column][[0, 3]], best.x[[0, 3]], atol=5e-4)
    znssd = 2 * (1 - field.zncc[row, column])
    assert znssd == pytest.approx(2 * best.cost, rel=0.01)


@pytest.mark.parametrize(
    "angle_deg",
    [*(22.5, 135.0, 180.0), *(pytest.param(deg, marks=pytest.mark.extended) for deg in (90.0, 300.0))],
)
def test_any_rotation_is_found_without_a_hint(speckle, turn, angle_deg):
    pattern = speckle(seed=5, shape=(240, 240), margin=60)
    centre = (119.5, 119.5)
    field = Correlator(pattern.draw(), settings=SMALL).correlate(pattern.draw(turn(angle_deg, centre)))
    assert field.start == "features"
    check_rotation(field, angle_deg, centre)


def test_the_stages_angle_is_a_start_and_says_so(speckle, turn):
    pattern = speckle(seed=6, shape=(240, 240), margin=60)
    centre, believed = (119.5, 119.5), (112.0, 125.0)
    c, s = np.cos(np.radians(100.0)), np.sin(np.radians(100.0))
    about = np.array([[1, 0, believed[0]], [0, 1, believed[1]], [0, 0, 1.0]])
    hint = about @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]) @ np.linalg.inv(about)
    field = Correlator(pattern.draw(), settings=SMALL).correlate(pattern.draw(turn(100.0, centre)), hint=hint)
    assert field.start == "hint"
    check_rotation(field, 100.0, centre)


def check_rotation(field, angle_deg, centre):
    c, s = np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))
    x, y = np.meshgrid(field.x_px - centre[0], field.y_px - centre[1])
    u, v = c * x + s * y - x, -s * x + c * y - y
    assert field.converged.sum() >= 0.99 * field.in_view
    assert field.in_view > 150
    assert np.nanmax(np.hypot(field.u_px - u, field.v_px - v)) < 0.02


def test_a_change_of_light_changes_nothing(speckle):
    pattern = speckle(seed=7)
    moved = pattern.draw(lambda x, y: (x - 0.4, y + 0.7))
    correlator = Correlator(pattern.draw(), settings=SMALL)
    plain, dimmed = correlator.correlate(moved), correlator.correlate(0.6 * moved + 31)
    np.testing.assert_allclose(dimmed.warps, plain.warps, atol=1e-4)


@pytest.mark.parametrize("dtype", [np.float32, np.uint8, np.uint16])
@pytest.mark.parametrize("large", [False, True])
def test_reference_whose_array_gets_the_next_image_stays_the_reference(speckle, dtype, large, monkeypatch):
    if large:
        monkeypatch.setattr("dic.image.stored.WHOLE_PX", 0)
    pattern = speckle(seed=7)
    buffer, moved = (
        image.clip(0.0, 255.0).round().astype(dtype)
        for image in (pattern.draw(), pattern.draw(lambda x, y: (x - 0.4, y + 0.7)))
    )
    correlator = Correlator(buffer, settings=SMALL)
    buffer[:] = moved
    field = correlator.correlate(buffer)
    assert field.converged.mean() > 0.9
    np.testing.assert_allclose(np.nanmedian(field.u_px), 0.4, atol=0.02)
    np.testing.assert_allclose(np.nanmedian(field.v_px), -0.7, atol=0.02)


def test_points_that_leave_the_view_are_told_apart_from_failures(speckle):
    pattern = speckle(seed=8)
    field = Correlator(pattern.draw(), settings=SMALL).correlate(pattern.draw(lambda x, y: (x - 40, y)))
    x = np.broadcast_to(field.x_px, field.status.shape)
    leaves = x + 40 + 10 >= pattern.shape[1] - 3
    np.testing.assert_array_equal(field.status == Status.OUT_OF_VIEW, leaves)
    assert np.isnan(field.u_px[leaves]).all()
    np.testing.assert_allclose(field.u_px[~leaves], 40, atol=2e-3)


def test_one_torn_half_does_not_spoil_the_other(speckle):
    pattern, other = speckle(seed=9), speckle(seed=10)
    torn = pattern.draw(lambda x, y: (x - 2.5, y))
    torn[:, 90:] = other.draw()[:, 90:]
    field = Correlator(pattern.draw(), settings=SMALL).correlate(torn)
    left = np.broadcast_to(field.x_px, field.status.shape) + 2.5 + 10 < 84
    np.testing.assert_allclose(field.u_px[left], 2.5, atol=2e-3)
    right = np.broadcast_to(field.x_px, field.status.shape) - 10 > 96
    assert not field.converged[right].any()
    assert np.isnan(field.u_px[right]).all()


def test_a_region_limits_points_and_pixels(speckle):
    pattern, other = speckle(seed=11), speckle(seed=12)
    moved = pattern.draw(lambda x, y: (x - 1.25, y))
    moved[:, 102:] = other.draw()[:, 102:]
    region = np.zeros(pattern.shape, bool)
    region[20:140, 25:100] = True
    field = Correlator(pattern.draw(), region, SMALL).correlate(moved)
    x, y = np.meshgrid(field.x_px, field.y_px)
    assert region[y, x][field.active].all()
    assert field.converged.sum() == field.active.sum()
    # Points at the edge use only pixels that the other pattern does not disturb, up to column 94.
    np.testing.assert_allclose(field.u_px[field.active], 1.25, atol=3e-3)
    assert (x[field.active] + 10 > 94).any()


def test_background_without_texture_gets_no_points(speckle):
    pattern = speckle(seed=13)
    reference = pattern.draw()
    reference[:70] = 8 + np.random.default_rng(0).normal(0, 1, (70, pattern.shape[1]))
    correlator = Correlator(reference, settings=SMALL)
    moved = pattern.draw(lambda x, y: (x - 1, y))
    field = correlator.correlate(moved)
    _, y = np.meshgrid(field.x_px, field.y_px)
    assert y[field.active].min() >= 70
    assert y[field.active].max() > 120


@pytest.mark.parametrize(
    ("values", "word"),
    [
        ({"subset_px": 30}, "odd"),
        ({"step_px": 0}, "step"),
        ({"order": 4}, "3 or 5"),
        ({"min_zncc": 1.5}, "ZNCC"),
    ],
)
def test_impossible_settings_are_refused(values, word):
    with pytest.raises(CorrelationError, match=word):
        CorrelationSettings(**values)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.int32, np.float64])
def test_images_of_any_number_are_measured_alike(speckle, dtype):
    pattern = speckle(seed=14)
    images = [np.rint(pattern.draw(back)) for back in (lambda x, y: (x, y), lambda x, y: (x - 0.5, y))]
    expected = Correlator(images[0], settings=SMALL).correlate(images[1])
    field = Correlator(images[0].astype(dtype), settings=SMALL).correlate(images[1].astype(dtype))
    np.testing.assert_array_equal(field.warps, expected.warps)


class TestUnusableImages:
    def test_without_texture(self):
        with pytest.raises(CorrelationError, match="texture"):
            Correlator(np.full((100, 100), 90, np.float32), settings=SMALL)

    def test_of_another_size(self, speckle):
        pattern = speckle()
        with pytest.raises(CorrelationError, match=r"180 x 160 px, got 180 x 150 px"):
            Correlator(pattern.draw(), settings=SMALL).correlate(pattern.draw()[:150])

    def test_of_another_surface(self, speckle):
        correlator = Correlator(speckle(seed=1).draw(), settings=SMALL)
        with pytest.raises(CorrelationError, match="find the reference's pattern"):
            correlator.correlate(speckle(seed=2).draw())

    def test_with_nan(self, speckle):
        image = speckle().draw()
        image[50, 50] = np.nan
        with pytest.raises(CorrelationError, match="finite"):
            Correlator(image, settings=SMALL)

    def test_a_deformed_one_with_infinity(self, speckle):
        image = speckle().draw()
        correlator = Correlator(image, settings=SMALL)
        spoilt = image.copy()
        spoilt[10, 10] = np.inf
        with pytest.raises(CorrelationError, match="deformed image: read: expected finite"):
            correlator.correlate(spoilt)

    @pytest.mark.parametrize("dtype", [complex, bool, "S4", "datetime64[s]"])
    def test_of_a_kind_that_holds_no_grey_levels(self, dtype):
        with pytest.raises(CorrelationError, match="grey levels"):
            Correlator(np.zeros((100, 100), dtype), settings=SMALL)

    def test_in_colour(self, speckle):
        colour = np.repeat(speckle().draw()[..., None], 3, axis=2)
        with pytest.raises(CorrelationError, match="colour image of 180 × 160 px"):
            Correlator(colour, settings=SMALL)

    def test_smaller_than_a_subset(self):
        with pytest.raises(CorrelationError, match="subset of 21 px"):
            Correlator(np.zeros((15, 200), np.float32), settings=SMALL)

    def test_region_without_room(self, speckle):
        region = np.zeros((160, 180), bool)
        region[80:83, 90:93] = True
        with pytest.raises(CorrelationError, match="holds subsets"):
            Correlator(speckle().draw(), region, SMALL)

    def test_region_without_points(self, speckle):
        with pytest.raises(CorrelationError, match="region of interest"):
            Correlator(speckle().draw(), np.zeros((160, 180), bool), SMALL)

    def test_region_of_another_size(self, speckle):
        with pytest.raises(CorrelationError, match="region of interest"):
            Correlator(speckle().draw(), np.ones((10, 10), bool), SMALL)
