"""Strain measures agree with the polar decomposition of the gradient, and with their derivatives."""

import numpy as np
import pytest
from scipy.linalg import logm, sqrtm

from dic.strain.measures import MEASURES
from dic.strain.measures.measure import green, of_stretch

BIOT = of_stretch(
    "biot", "Biot", lambda squared: np.sqrt(squared) - 1.0, lambda squared: 1.0 / np.sqrt(squared)
)
GRADIENTS = np.random.default_rng(2).normal(0.0, 0.2, (20, 2, 2))


def vector(tensor):
    return np.array([tensor[0, 0], tensor[1, 1], tensor[0, 1]])


@pytest.mark.parametrize(
    ("measure", "of_right_cauchy_green"),
    [
        (BIOT, lambda c: sqrtm(c) - np.eye(2)),
        (MEASURES["hencky"], lambda c: 0.5 * logm(c)),
        (MEASURES["green-lagrange"], lambda c: (c - np.eye(2)) / 2),
    ],
)
def test_strain_is_that_of_the_right_cauchy_green_tensor(measure, of_right_cauchy_green):
    strain, _ = measure.tensor(GRADIENTS)
    for gradient, found in zip(GRADIENTS, strain, strict=True):
        deformation = np.eye(2) + gradient
        expected = vector(of_right_cauchy_green(deformation.T @ deformation))
        np.testing.assert_allclose(found, expected, atol=1e-12)


@pytest.mark.parametrize("measure", [BIOT, MEASURES["hencky"]])
def test_derivatives_are_those_of_small_changes_of_the_green_lagrange_strain(measure):
    gradient, step = np.array([[0.08, 0.03], [-0.02, -0.05]]), 1e-6
    _, by_green = measure.tensor(gradient)
    for change in ((step, 0.0, 0.0, 0.0), (0.0, step, 0.0, 0.0), (0.0, 0.0, 0.0, step)):
        moved = gradient + np.reshape(change, (2, 2))
        difference = measure.tensor(moved)[0] - measure.tensor(gradient)[0]
        np.testing.assert_allclose(by_green @ (green(moved) - green(gradient)), difference, atol=1e-10)


@pytest.mark.parametrize("name", MEASURES)
def test_derivative_of_engineering_strain_is_that_along_a_stretched_axis(name):
    def along(stretch):
        return MEASURES[name].tensor(np.array([[stretch - 1.0, 0.0], [0.0, 0.0]]))[0][0]

    slope = (along(1.3 + 1e-6) - along(1.3 - 1e-6)) / 2e-6
    assert MEASURES[name].by_engineering(1.3) == pytest.approx(1.0 / slope, rel=1e-8)
