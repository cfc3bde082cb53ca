"""Strains of motions whose strain is known in closed form."""

import numpy as np
import pytest

from dic.displacement import Displacement
from dic.errors import CorrelationError
from dic.strain import mean_strain, strain_field

X, Y = np.meshgrid(np.linspace(-4, 5, 12), np.linspace(-3, 6, 10))


def moved(to):
    position = np.stack([X, Y], axis=-1)
    return Displacement(position, np.stack(to(X, Y), axis=-1) - position, np.ones(X.shape, bool), "mm")


@pytest.mark.parametrize("angle_deg", [0.0, 22.5, 90.0, 180.0, -135.0])
def test_a_rigid_turn_strains_nothing(angle_deg):
    c, s = np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))
    strain = mean_strain(moved(lambda x, y: (c * x - s * y + 3, s * x + c * y - 7)))
    np.testing.assert_allclose([strain.exx, strain.eyy, strain.exy], 0, atol=1e-14)
    assert np.cos(np.radians(strain.rotation_deg - angle_deg)) == pytest.approx(1, abs=1e-14)


def test_a_stretch_gives_half_of_its_square_less_one():
    strain = mean_strain(moved(lambda x, y: (0.97 * x, 1.05 * y)))
    assert strain.exx == pytest.approx((0.97**2 - 1) / 2)
    assert strain.eyy == pytest.approx((1.05**2 - 1) / 2)
    assert strain.exy == pytest.approx(0, abs=1e-14)


def test_simple_shear_turns_x_towards_y_when_y_moves():
    strain = mean_strain(moved(lambda x, y: (x, y + 0.02 * x)))
    assert strain.exy == pytest.approx(0.01)
    assert strain.rotation_deg == pytest.approx(np.degrees(np.arctan(0.01)))


def test_the_mean_uses_valid_points_only():
    motion = moved(lambda x, y: (1.01 * x, y))
    spoiled = motion.vector.copy()
    spoiled[2, 3] = 100.0
    spoiled[4, 5] = np.nan
    valid = motion.valid.copy()
    valid[2, 3] = valid[4, 5] = False
    strain = mean_strain(Displacement(motion.position, spoiled, valid, "mm"))
    assert strain.exx == pytest.approx((1.01**2 - 1) / 2)
    assert strain.points == X.size - 2


@pytest.mark.parametrize("count", [0, 2])
def test_too_few_points_have_no_strain(count):
    valid = np.zeros(X.shape, bool)
    valid.ravel()[:count] = True
    strain = mean_strain(moved(lambda x, y: (x, y)), valid)
    assert np.isnan([strain.exx, strain.eyy, strain.exy, strain.rotation_deg]).all()
    assert strain.as_dict()["exx"] is None


def test_points_on_one_line_have_no_strain():
    valid = np.zeros(X.shape, bool)
    valid[3] = True
    assert np.isnan(mean_strain(moved(lambda x, y: (x, y)), valid).exx)


def test_local_strain_follows_a_gradient_of_strain():
    # u = k x²/2 has ∂u/∂x = k x, which a plane fitted to a symmetric window meets exactly at its middle.
    k = 1e-3
    field = strain_field(moved(lambda x, y: (x + k * x**2 / 2, y)), 5)
    expected = ((1 + k * X) ** 2 - 1) / 2
    np.testing.assert_allclose(field.exx[:, 2:-2], expected[:, 2:-2], atol=1e-12)
    np.testing.assert_allclose(field.eyy[:, 2:-2], 0, atol=1e-12)


def test_local_strain_is_missing_where_its_window_is_too_empty():
    motion = moved(lambda x, y: (1.01 * x, y))
    valid = motion.valid.copy()
    valid[:, :6] = False
    field = strain_field(Displacement(motion.position, motion.vector, valid, "mm"), 5)
    assert np.isnan(field.exx[:, :6]).all()
    assert np.isfinite(field.exx[2:-2, 6:-2]).all()


@pytest.mark.parametrize("window", [1, 4])
def test_impossible_windows_are_refused(window):
    with pytest.raises(CorrelationError, match="odd number of points"):
        strain_field(moved(lambda x, y: (x, y)), window)
