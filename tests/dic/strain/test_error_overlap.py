"""Points whose subsets share pixels have correlated errors, also where edges and cracks clip the subsets."""

import numpy as np
import pytest

import dic.strain.error_overlap as module
from dic.correlation.settings import CorrelationSettings
from dic.image.point_grid import connected_part, place_points
from dic.strain.error_overlap import ClippedSubsets, clipped_subsets, error_overlap

SETTINGS = CorrelationSettings(subset_px=21, step_px=6)


def holed_plate():
    """Return a grid of points on a plate with a round hole and a slit that ends within subsets."""
    y, x = np.mgrid[:110, :140]
    region = np.hypot(x - 45, y - 40) > 12
    region[70:73, 60:] = False
    return place_points(region, region, 21, 6)


def pixel_weights(grid, row, column):
    """Return the weight of each pixel of the image in the displacement of a point, from a pseudo-inverse."""
    r, x0, y0 = SETTINGS.radius_px, int(grid.x[column]), int(grid.y[row])
    y, x = np.nonzero(connected_part(grid.usable, x0, y0, r))
    dx, dy = (x - r) / r, (y - r) / r
    terms = np.column_stack([np.ones(len(x)), dx, dy, dx * dx, dx * dy, dy * dy])
    weights = np.zeros(grid.usable.shape)
    weights[y0 - r + y, x0 - r + x] = np.linalg.pinv(terms)[0]
    return weights / np.linalg.norm(weights)


def test_clipped_subsets_share_errors_as_the_pseudo_inverses_of_their_pixels_say():
    grid, reach = holed_plate(), 2
    subsets = ClippedSubsets(grid, SETTINGS)
    table = subsets.correlations(reach)
    whole = np.pad(error_overlap(SETTINGS), ((0, 3), (0, 3)))
    places = {(int(i), int(j)): pixel_weights(grid, i, j) for i, j in np.argwhere(grid.active)}
    clipped = [place for place in places if grid.pixels[place] < 21**2]
    assert any(grid.cut[place] for place in clipped)
    assert 20 < len(clipped) < len(places) - 20
    numbers = subsets.numbers_around(*np.array(clipped).T, 0).ravel()
    away_from_whole = 0.0
    for place, number in zip(clipped, numbers, strict=True):
        for down, right in np.ndindex(5, 5):
            other = place[0] + down - reach, place[1] + right - reach
            if other in places:
                shared = (places[place] * places[other]).sum()
                assert table[number, down, right] == pytest.approx(shared, abs=1e-4)
                away_from_whole = max(away_from_whole, abs(shared - whole[abs(down - 2), abs(right - 2)]))
    assert away_from_whole > 0.2


def test_whole_subsets_have_no_number():
    grid = holed_plate()
    subsets = ClippedSubsets(grid, SETTINGS)
    rows, columns = np.nonzero(grid.active & (grid.pixels == 21**2))
    assert (subsets.numbers_around(rows, columns, 0) == -1).all()
    everywhere = np.ones((90, 90), bool)
    assert clipped_subsets(place_points(everywhere, everywhere, 21, 6), SETTINGS) is None


def test_the_memory_does_not_change_the_correlations(monkeypatch):
    grid = holed_plate()
    at_once = ClippedSubsets(grid, SETTINGS).correlations(3)
    np.testing.assert_allclose(at_once[:, 3, 3], 1.0, atol=1e-5, err_msg="of each subset with itself")
    monkeypatch.setattr(module, "_PIXELS_IN_MEMORY", 20 * 21**2)
    monkeypatch.setattr(module, "_PIXELS_IN_FLOAT64", 3 * 21**2)
    np.testing.assert_allclose(ClippedSubsets(grid, SETTINGS).correlations(3), at_once, atol=1e-5)
