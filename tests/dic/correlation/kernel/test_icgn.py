"""The compiled kernel is compared with the same method in plain NumPy, and with theory."""

import numpy as np
import pytest

from dic.correlation.correlator import Correlator
from dic.correlation.reference_icgn import icgn
from dic.correlation.settings import CorrelationSettings
from dic.correlation.status import Status
from dic.image.spline import spline_image


def waves(x, y):
    """A small deformation whose strain varies within a subset, as a function `back` for `SpecklePattern`."""
    return x - 1.4 - 0.01 * x - 1e-4 * (y - 80) ** 2, y + 0.8 + 0.012 * x - 6e-5 * (x - 90) ** 2


def check_same_as_numpy(reference, deformed, settings, region=None, usable=None, points=3, atol=1e-5):
    region, usable = (np.ones(reference.shape, bool) if mask is None else mask for mask in (region, usable))
    field = Correlator(reference, region, settings).correlate(deformed)
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


@pytest.mark.parametrize(
    ("order", "subset_px", "shape"),
    [
        *((3, 21, "affine"), (5, 15, "quadratic")),
        *(
            pytest.param(*case, marks=pytest.mark.extended)
            for case in ((3, 21, "quadratic"), (5, 31, "affine"), (5, 31, "quadratic"), (5, 15, "affine"))
        ),
    ],
)
def test_a_smooth_warp_is_that_of_plain_numpy(speckle, shape, order, subset_px):
    pattern = speckle(seed=30, noise=1.0)
    settings = CorrelationSettings(subset_px, 25, shape=shape, order=order, tolerance_px=1e-7)
    check_same_as_numpy(pattern.draw(noise_seed=1), pattern.draw(waves, noise_seed=2), settings)


@pytest.mark.parametrize("shape", [pytest.param("affine", marks=pytest.mark.extended), "quadratic"])
def test_a_large_rotation_is_that_of_plain_numpy(speckle, turn, shape):
    pattern = speckle(seed=31, noise=1.0, margin=60)
    settings = CorrelationSettings(21, 25, shape=shape, tolerance_px=2e-6)
    moved = pattern.draw(turn(37.0, (90, 80), scale=1.05), noise_seed=2)
    check_same_as_numpy(pattern.draw(noise_seed=1), moved, settings)


@pytest.mark.parametrize("angle_deg", [pytest.param(0.4, marks=pytest.mark.extended), 37.0])
def test_a_clipped_subset_is_that_of_plain_numpy(speckle, turn, angle_deg):
    pattern = speckle(seed=32, noise=1.0, margin=60)
    region = np.zeros(pattern.shape, bool)
    region[30:130, 40:65] = True
    # The quintic spline is disturbed up to 5 px from the region's edge.
    usable = np.zeros(pattern.shape, bool)
    usable[35:125, 45:60] = True
    settings = CorrelationSettings(21, 10, shape="affine", tolerance_px=1e-7)
    moved = pattern.draw(turn(angle_deg, (90, 80)), noise_seed=2)
    check_same_as_numpy(pattern.draw(noise_seed=1), moved, settings, region, usable)


@pytest.mark.extended
def test_second_derivatives_that_move_the_edge_by_two_pixels_are_found(speckle):
    """The affine optimum of a bent subset is so far from the quadratic one that affine steps end there."""
    pattern = speckle(seed=37, noise=1.0)
    bent = pattern.draw(lambda x, y: (x - 1.2 * np.sin(2 * np.pi * y / 75.0), y), noise_seed=2)
    settings = CorrelationSettings(41, 12, tolerance_px=1e-6)
    check_same_as_numpy(pattern.draw(noise_seed=1), bent, settings, points=2)
    field = Correlator(pattern.draw(noise_seed=1), np.ones(pattern.shape, bool), settings).correlate(bent)
    assert field.converged.all()


def test_several_threads_find_what_one_finds(speckle):
    pattern = speckle(seed=33, shape=(200, 180), noise=1.0)
    reference, deformed = pattern.draw(noise_seed=1), pattern.draw(waves, noise_seed=2)
    settings = CorrelationSettings(21, 8, tolerance_px=1e-6)
    region = np.ones(pattern.shape, bool)
    one, three = (Correlator(reference, region, settings, threads=n).correlate(deformed) for n in (1, 3))
    np.testing.assert_array_equal(three.status, one.status)
    np.testing.assert_allclose(three.warps, one.warps, atol=1e-5)


@pytest.mark.parametrize(
    ("shape", "noise"),
    [
        *(("affine", 8.0), ("quadratic", 2.0)),
        *(pytest.param(*case, marks=pytest.mark.extended) for case in (("affine", 2.0), ("quadratic", 8.0))),
    ],
)
def test_predicted_std_is_that_of_repeated_images(speckle, shape, noise):
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
    """Return the image with its right half replaced by one grey level with a little noise."""
    image = image.astype(np.float64)
    image[:, 90:] = np.random.default_rng(seed).normal(grey, noise, image[:, 90:].shape)
    return np.rint(image) if whole else image


@pytest.mark.parametrize("shape", ["affine", pytest.param("quadratic", marks=pytest.mark.extended)])
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
