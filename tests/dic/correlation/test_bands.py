"""Large images, which are laid in bands of rows: the ends of bands change no result."""

import numpy as np
import pytest

from dic.correlation.correlator import Correlator
from dic.correlation.initial_guess import rigid_motion
from dic.correlation.settings import CorrelationSettings
from dic.correlation.status import Status

SHAPE = (420, 300)
SETTINGS = CorrelationSettings(21, 7)


@pytest.fixture
def in_bands(monkeypatch):
    """`in_bands(True)` lets images of any size be laid in bands, `in_bands(False)` lays them as a whole."""
    return lambda large: monkeypatch.setattr("dic.image.stored.WHOLE_PX", 0 if large else SHAPE[0] * SHAPE[1])


def both(in_bands, reference, images, *, settings=SETTINGS, region=None, hint=None):
    """Return the fields of a series, laid as a whole and in bands."""
    fields = []
    for large in (False, True):
        in_bands(large)
        region = np.ones(SHAPE, bool) if region is None else region
        correlator, previous, found = Correlator(reference, region, settings, threads=2), None, []
        for image in images:
            previous = correlator.correlate(image, previous=previous, hint=hint)
            found.append(previous)
        fields.append(found)
    return zip(*fields, strict=True)


def assert_same(whole, banded):
    assert whole.converged.sum() > 0.5 * whole.active.sum()
    for name in ("warps", "std", "zncc", "status", "iterations", "active"):
        np.testing.assert_array_equal(getattr(banded, name), getattr(whole, name), err_msg=name)


def pictures(speckle, *motions, kind=np.uint8):
    pattern = speckle(seed=71, shape=SHAPE, noise=1.0)
    drawn = [pattern.draw(noise_seed=1), *(pattern.draw(m, noise_seed=k) for k, m in enumerate(motions, 2))]
    return [np.clip(np.rint(image), 0, 255).astype(kind) for image in drawn]


def stretched(x, y):
    """Strain along y and shear: where a picture's pixel comes from. Rows move by up to 17 px."""
    return x - 2.3 - 0.01 * y, y + 3.6 - 0.04 * y - 0.012 * x


@pytest.mark.parametrize(
    ("shape", "smoothing_px"),
    [
        *(("affine", 0.7), ("quadratic", 0.0)),
        *(pytest.param(*case, marks=pytest.mark.extended) for case in (("affine", 0.0), ("quadratic", 0.7))),
    ],
)
def test_bands_of_a_series_give_the_same_fields(speckle, in_bands, shape, smoothing_px):
    settings = CorrelationSettings(21, 10, shape=shape, smoothing_px=smoothing_px)
    reference, *images = pictures(speckle, stretched, lambda x, y: stretched(x + 0.4, y - 0.3))
    for whole, banded in both(in_bands, reference, images, settings=settings):
        assert_same(whole, banded)


def test_bands_beside_cracks_and_holes_give_the_same_field(speckle, in_bands):
    reference, image = pictures(speckle, lambda x, y: (x - 1.3, y + 2.4))
    region = np.ones(SHAPE, bool)
    region[150:153, 60:240] = region[250:300, 100:160] = False
    ((whole, banded),) = both(in_bands, reference, [image], region=region)
    assert whole.grid.cut.any()
    assert_same(whole, banded)


@pytest.mark.parametrize("angle_deg", [pytest.param(3.0, marks=pytest.mark.extended), 25.0])
def test_a_rotation_of_which_the_angle_is_known_gives_the_same_field(speckle, turn, in_bands, angle_deg):
    centre = (150.0, 210.0)
    reference, image = pictures(speckle, turn(angle_deg, centre))
    hint = rigid_motion(angle_deg, (0.0, 0.0), centre)
    ((whole, banded),) = both(in_bands, reference, [image], hint=hint)
    assert_same(whole, banded)


@pytest.mark.extended
def test_an_upside_down_image_is_found_in_bands(speckle, turn, in_bands):
    """The features may differ a little, because an image in bands is reduced before it is stretched."""
    reference, image = pictures(speckle, turn(178.0, (150.0, 210.0)))
    ((whole, banded),) = both(in_bands, reference, [image])
    np.testing.assert_array_equal(banded.status, whole.status)
    np.testing.assert_allclose(banded.warps[whole.converged], whole.warps[whole.converged], atol=1e-3)


@pytest.mark.extended
def test_a_second_body_that_moves_by_many_rows_is_found_in_bands(speckle, in_bands):
    """Its displacement differs from that of the first by more rows than are laid at first."""
    reference, image = pictures(speckle, lambda x, y: (x - 0.6, y + 0.4))
    moved = image.copy()
    moved[40:180, 150:300] = image[100:240, 150:300]
    ((whole, banded),) = both(in_bands, reference, [moved])
    alike = whole.status == banded.status
    assert alike.mean() > 0.98
    together = whole.converged & banded.converged
    np.testing.assert_allclose(banded.warps[together][:, [0, 3]], whole.warps[together][:, [0, 3]], atol=2e-3)
    second = [np.count_nonzero(field.converged & (field.v_px < -50)) for field in (whole, banded)]
    assert second[0] > 150
    assert second[1] >= 0.98 * second[0]


def test_points_out_of_view_are_the_same_in_bands(speckle, in_bands):
    reference, image = pictures(speckle, lambda x, y: (x - 30.2, y + 41.7))
    ((whole, banded),) = both(in_bands, reference, [image])
    assert whole.count(Status.OUT_OF_VIEW) > 50
    np.testing.assert_array_equal(banded.status, whole.status)
    np.testing.assert_array_equal(banded.warps[whole.converged], whole.warps[whole.converged])
