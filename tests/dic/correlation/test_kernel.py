"""The compiled kernel against the same method in plain NumPy, and against what theory says of its numbers."""

import numpy as np
import pytest

from dic.correlation import kernel
from dic.correlation.correlator import Correlator
from dic.correlation.prepared_reference import SubsetMemory
from dic.correlation.reference_icgn import icgn
from dic.correlation.settings import CorrelationSettings
from dic.correlation.solver import Solver
from dic.correlation.status import Status
from dic.image.point_grid import PointGrid
from dic.image.spline import spline_image

NEAR = np.array([0.3, 0, 0, -0.2, 0, 0])
"""From the truth to where iterations start."""


def waves(x, y):
    """A gentle deformation whose strain changes within a subset: where a picture's pixel comes from."""
    return x - 1.4 - 0.01 * x - 1e-4 * (y - 80) ** 2, y + 0.8 + 0.012 * x - 6e-5 * (x - 90) ** 2


def check_same_as_numpy(reference, deformed, settings, region=None, points=3, atol=1e-5):
    usable = np.ones(reference.shape, bool) if region is None else region
    field = Correlator(reference, usable, settings).correlate(deformed)
    f, g = (spline_image(image, settings.order) for image in (reference, deformed))
    rows, columns = np.nonzero(field.converged)
    assert len(rows) > points
    for k in np.linspace(0, len(rows) - 1, points).astype(int):
        warp = field.warps[rows[k], columns[k]]
        point = int(field.x_px[columns[k]]), int(field.y_px[rows[k]])
        start = np.zeros(settings.parameters)
        start[:6] = warp[:6] + np.array([0.2, 0, 0, -0.1, 0, 0])
        expected, zncc = icgn(f, g, usable, point, settings.radius_px, start)
        scale = np.array([1, 10, 10] * 2 + [100] * (settings.parameters - 6))
        np.testing.assert_allclose(warp * scale, expected * scale, atol=atol)
        assert field.zncc[rows[k], columns[k]] == pytest.approx(zncc, abs=1e-5)


@pytest.mark.parametrize("shape", ["affine", "quadratic"])
@pytest.mark.parametrize(("order", "subset_px"), [(3, 21), (5, 31), (5, 15)])
def test_a_smooth_warp_is_that_of_plain_numpy(speckle, shape, order, subset_px):
    pattern = speckle(seed=30, noise=1.0)
    settings = CorrelationSettings(subset_px, 25, shape=shape, order=order, tolerance_px=1e-7)
    check_same_as_numpy(pattern.draw(noise_seed=1), pattern.draw(waves, noise_seed=2), settings)


@pytest.mark.parametrize("shape", ["affine", "quadratic"])
def test_a_large_rotation_is_that_of_plain_numpy(speckle, turn, shape):
    pattern = speckle(seed=31, noise=1.0, margin=60)
    settings = CorrelationSettings(21, 25, shape=shape, tolerance_px=2e-6)
    moved = pattern.draw(turn(37.0, (90, 80), scale=1.05), noise_seed=2)
    check_same_as_numpy(pattern.draw(noise_seed=1), moved, settings)


@pytest.mark.parametrize("angle_deg", [0.4, 37.0])
def test_a_clipped_subset_is_that_of_plain_numpy(speckle, turn, angle_deg):
    pattern = speckle(seed=32, noise=1.0, margin=60)
    region = np.zeros(pattern.shape, bool)
    region[30:130, 40:61] = True
    settings = CorrelationSettings(21, 10, tolerance_px=1e-7)
    moved = pattern.draw(turn(angle_deg, (90, 80)), noise_seed=2)
    check_same_as_numpy(pattern.draw(noise_seed=1), moved, settings, region)


def test_several_threads_find_what_one_finds(speckle):
    pattern = speckle(seed=33, shape=(200, 180), noise=1.0)
    reference, deformed = pattern.draw(noise_seed=1), pattern.draw(waves, noise_seed=2)
    settings = CorrelationSettings(21, 8, tolerance_px=1e-6)
    region = np.ones(pattern.shape, bool)
    one, three = (Correlator(reference, region, settings, threads=n).correlate(deformed) for n in (1, 3))
    np.testing.assert_array_equal(three.status, one.status)
    np.testing.assert_allclose(three.warps, one.warps, atol=1e-5)


@pytest.mark.parametrize("noise", [2.0, 8.0])
@pytest.mark.parametrize("shape", ["affine", "quadratic"])
def test_predicted_deviations_are_those_that_repeated_images_show(speckle, shape, noise):
    pattern = speckle(seed=34, shape=(130, 130))
    settings = CorrelationSettings(21, 24, shape=shape, min_zncc=0.3)
    region = np.ones(pattern.shape, bool)
    still, moved = pattern.draw(), pattern.draw(lambda x, y: (x - 0.35, y + 0.2))
    rng = np.random.default_rng(7)
    warps, predicted = [], []
    for _ in range(60):
        a, b = (image + rng.normal(0, noise, image.shape).astype(np.float32) for image in (still, moved))
        field = Correlator(a, region, settings).correlate(b)
        warps.append(field.warps[..., :6])
        predicted.append(field.std)
    observed = np.sqrt(np.var(warps, axis=0).mean(axis=(0, 1)))
    stated = np.sqrt(np.mean(np.square(predicted), axis=(0, 1, 2)))
    np.testing.assert_allclose(stated, observed, rtol=0.10)


def half_flat(image, seed, *, noise, grey=128.0, whole=False):
    """The image, whose right half is one grey level with a little noise."""
    image = image.astype(np.float64)
    image[:, 90:] = np.random.default_rng(seed).normal(grey, noise, image[:, 90:].shape)
    return np.rint(image) if whole else image


@pytest.mark.parametrize("shape", ["affine", "quadratic"])
@pytest.mark.parametrize(
    ("flat", "scale"),
    [
        ({"noise": 0.0}, 1.0),
        ({"noise": 0.0, "grey": 250.0, "whole": True}, 1.0),
        ({"noise": 1e-3}, 1.0),
        ({"noise": 0.05}, 1.0),
        ({"noise": 0.2, "whole": True}, 1.0),
        ({"noise": 1e-3}, 1 / 255),
        ({"noise": 1e-3}, 257.0),
    ],
    ids=str,
)
def test_where_nothing_but_rounding_is_seen_there_is_no_texture(speckle, shape, flat, scale):
    pattern = speckle(seed=35)
    images = pattern.draw(), pattern.draw(lambda x, y: (x - 0.4, y + 0.3))
    still, moved = (
        (scale * half_flat(image, seed, **flat)).astype(np.float32) for seed, image in enumerate(images)
    )
    settings = CorrelationSettings(21, 8, shape=shape)
    field = Correlator(still, np.ones(still.shape, bool), settings).correlate(moved)
    patterned, plain = field.x_px < 90 - 25, field.x_px > 90 + 20
    assert patterned.any()
    assert plain.any()
    assert (field.status[:, plain] == Status.NO_TEXTURE).all()
    assert (field.status[:, patterned] == Status.CONVERGED).all()


def test_a_faint_pattern_is_still_measured(speckle):
    """Two grey levels of contrast, at the bright end of an image that holds much more."""
    pattern = speckle(seed=36)
    still, moved = pattern.draw(), pattern.draw(lambda x, y: (x - 0.4, y + 0.3))
    for image in (still, moved):
        image[:, 90:] = 240 + 0.04 * (image[:, 90:] - 128)
    field = Correlator(still, np.ones(still.shape, bool), CorrelationSettings(21, 8)).correlate(moved)
    faint = field.x_px > 90 + 20
    assert (field.status[:, faint] == Status.CONVERGED).all()
    np.testing.assert_allclose(field.u_px[:, faint], 0.4, atol=0.005)


def solver_of(reference, deformed, settings):
    """A solver of all points of `reference` in an image of any shape."""
    solved = Correlator(reference, np.ones(reference.shape, bool), settings)
    laid = kernel.lay_coefficients(spline_image(deformed, settings.order), float(reference.mean()))
    return Solver(solved._reference, laid)


def points_of(solver, indices):
    grid = solver._reference.grid
    return grid.x[indices[:, 1]], grid.y[indices[:, 0]]


@pytest.mark.parametrize("shape", ["affine", "quadratic"])
@pytest.mark.parametrize(("height", "width"), [(160, 120), (130, 260)])
def test_a_deformed_image_may_be_narrower_or_wider_than_the_reference(speckle, shape, height, width):
    pattern = speckle(seed=37, shape=(160, 180))
    image = pattern.draw()
    deformed = np.pad(image, ((0, 0), (0, 80)), mode="reflect")[160 - height :, :width]
    solver = solver_of(image, deformed, CorrelationSettings(21, 12, shape=shape))
    rows, columns = solver._reference.grid.active.nonzero()
    indices = np.stack([rows, columns], axis=1)
    cropped = np.array([0.0, 0, 0, height - 160.0, 0, 0])
    solved = solver.solve(indices, np.tile(cropped + NEAR, (len(indices), 1)))
    x, y = points_of(solver, indices)
    seen = (x + 10 < width - 4) & (y - 10 + cropped[3] >= 4)
    assert seen.any()
    assert solved.converged[seen].all()
    np.testing.assert_allclose(solved.warps[seen, :6], np.tile(cropped, (seen.sum(), 1)), atol=1e-4)
    lost = (x + 10 >= width) | (y - 10 + cropped[3] < 0)
    assert (solved.status[lost] == Status.OUT_OF_VIEW).all()


@pytest.mark.parametrize("shape", ["affine", "quadratic"])
def test_an_image_turned_upright_is_another_shape_and_correlates(speckle, shape):
    """np.rot90 moves whole pixels: the pixel at (x, y) goes to (y, width - 1 - x)."""
    pattern = speckle(seed=38, shape=(110, 180))
    image = pattern.draw()
    solver = solver_of(image, np.rot90(image), CorrelationSettings(21, 15, shape=shape))
    rows, columns = solver._reference.grid.active.nonzero()
    indices = np.stack([rows, columns], axis=1)
    x, y = points_of(solver, indices)
    one = np.ones(len(x))
    exact = np.stack([y - x, -one, one, 179 - x - y, -one, -one], axis=1)
    solved = solver.solve(indices, exact + NEAR)
    inside = (x > 16) & (x < 163) & (y > 16) & (y < 93)
    assert solved.converged[inside].all()
    np.testing.assert_allclose(solved.warps[inside, :6], exact[inside], atol=1e-4)


@pytest.mark.parametrize("shape", ["affine", "quadratic"])
def test_what_is_kept_for_a_series_does_not_change_results(speckle, shape):
    pattern = speckle(seed=39, shape=(150, 240), noise=1.0)
    region = np.ones(pattern.shape, bool)
    region[40:70, 100:115] = False
    reference = pattern.draw(noise_seed=1)
    images = [pattern.draw(lambda x, y, k=k: waves(x + k / 4, y), noise_seed=2 + k) for k in range(3)]
    settings = CorrelationSettings(21, 6, shape=shape)
    series = Correlator(reference, region, settings)
    for image in images:
        kept = series.correlate(image)
        alone = Correlator(reference, region, settings).correlate(image)
        assert kept.converged.any()
        for name in ("warps", "std", "zncc", "status", "iterations"):
            np.testing.assert_array_equal(getattr(kept, name), getattr(alone, name), err_msg=name)
    assert series._reference.memory.kept_bytes > 0


@pytest.mark.parametrize("shape", ["affine", "quadratic"])
@pytest.mark.parametrize("step_px", [1, 5, 20])
def test_a_series_keeps_nothing_of_a_pair_and_no_more_than_four_and_a_quarter_images(shape, step_px):
    side = 1000
    at = np.arange(20, side - 20, step_px)
    everywhere = np.ones((len(at), len(at)), bool)
    grid = PointGrid(at, at, everywhere, everywhere.astype(np.int64), ~everywhere)
    memory, parameters = SubsetMemory(), CorrelationSettings(shape=shape).parameters
    sizes = []
    for _ in range(4):
        memory.for_next_image(grid, side * side, parameters)
        sizes.append(memory.kept_bytes)
    assert sizes[0] == 0
    assert sizes[1] == sizes[2] == sizes[3] <= 4.25 * 4 * side * side + everywhere.size
    assert (sizes[1] > 0) == (step_px >= 5)
