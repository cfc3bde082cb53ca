"""Tests of points solved in deformed images of any shape, and of the search for neighbouring points."""

import numpy as np
import pytest

from dic.correlation.correlator import Correlator
from dic.correlation.laid_rows import LaidDeformed
from dic.correlation.settings import CorrelationSettings
from dic.correlation.solver import Solver, next_to
from dic.correlation.status import Status
from dic.image.spline import spline_image
from dic.image.stored import StoredImage

NEAR = np.array([0.3, 0, 0, -0.2, 0, 0])
"""Error, px, of the displacements from which the iterations start."""


def test_next_to_an_element_is_up_down_left_or_right():
    mask = np.zeros((4, 5), bool)
    mask[1, 2] = True
    found = {tuple(map(int, place)) for place in np.argwhere(next_to(mask))}
    assert found == {(0, 2), (2, 2), (1, 1), (1, 3)}


def solver_of(reference, deformed, settings):
    """Return a solver for all points of `reference` in a deformed image of any shape."""
    solved = Correlator(reference, np.ones(reference.shape, bool), settings)
    laid = LaidDeformed(StoredImage(deformed), settings.order, float(reference.mean()), 1)
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
def test_one_step_leaves_less_of_the_error_than_the_noise_of_the_slopes_would(speckle, shape):
    """A plain Gauss-Newton step leaves the share of noise in ∑fx²: the Hessian has it, the image has not."""
    noise = 8.0
    clean, noisy = (speckle(seed=39, noise=each).draw(noise_seed=1) for each in (0.0, noise))
    deformed = speckle(seed=39, noise=noise).draw(lambda x, y: (x - 0.3, y + 0.4), noise_seed=2)
    along_x, along_x_noisy = (spline_image(image, 5).gradient()[0] for image in (clean, noisy))
    share = 1 - (along_x**2).mean() / (along_x_noisy**2).mean()
    found = []
    for tolerance in (1e-5, 1.0):
        settings = CorrelationSettings(31, 10, shape, min_zncc=0.5, tolerance_px=tolerance)
        solver = solver_of(noisy, deformed, settings)
        indices = np.argwhere(solver._reference.grid.active)
        if not found:
            start = solver.solve(indices, np.tile([0.3, 0, 0, -0.4, 0, 0], (len(indices), 1))).warps[:, :6]
        found.append(solver.solve(indices, start + np.array([0.15, 0, 0, 0, 0, 0])))
    known = found[0].converged & found[1].converged
    assert known.mean() > 0.9
    assert (found[1].iterations[known] == 1).all()
    left = np.median((found[1].warps - found[0].warps)[known, 0]) / 0.15
    assert share > 0.1
    assert abs(left) < share / 2
