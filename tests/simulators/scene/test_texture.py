import numpy as np
import pytest

from simulators.scene.texture import BRIGHT, DARK, LineGrid, Speckle

PX_PER_MM = 70.0


def speckle_picture(size_px=512, seed=1):
    axis = np.arange(size_px) / PX_PER_MM
    points = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
    return Speckle.sprayed(seed).reflectance(points).reshape(size_px, size_px)


def test_all_crossings_are_dark_and_all_cells_bright():
    grid = LineGrid()
    lines = np.linspace(-5, 5, 21)
    cells = lines[:-1] + 0.25
    crossings_mm = np.stack(np.meshgrid(lines, lines), axis=-1).reshape(-1, 2)
    cells_mm = np.stack(np.meshgrid(cells, cells), axis=-1).reshape(-1, 2)
    np.testing.assert_allclose(grid.reflectance(crossings_mm), DARK, atol=1e-12)
    np.testing.assert_allclose(grid.reflectance(cells_mm), BRIGHT, atol=1e-12)


def test_a_line_is_half_dark_at_its_nominal_edges():
    edges_mm = np.array([[1.0 - 0.04, 0.2], [1.0 + 0.04, 0.2], [0.2, -5.0 - 0.04]])
    np.testing.assert_allclose(LineGrid().reflectance(edges_mm), (DARK + BRIGHT) / 2, atol=1e-12)


def test_lines_overhang_and_the_plate_ends():
    on_the_overhang, past_it, off_the_plate = LineGrid().reflectance(
        np.array([[2.0, 5.08], [2.0, 5.2], [2.0, 6.1]])
    )
    assert on_the_overhang == pytest.approx(DARK)
    assert past_it == pytest.approx(BRIGHT)
    assert off_the_plate == pytest.approx(BRIGHT / 2)


def test_a_mark_is_a_dot_in_three_of_the_middle_cells():
    cells_mm = np.array([[-0.25, -0.25], [0.25, -0.25], [-0.25, 0.25], [0.25, 0.25]])
    edge_mm = cells_mm[:1] + np.array([0.075, 0.0])
    marked, plain = LineGrid(marked=True), LineGrid()
    np.testing.assert_allclose(marked.reflectance(cells_mm), [DARK, DARK, DARK, BRIGHT], atol=1e-12)
    np.testing.assert_allclose(marked.reflectance(edge_mm), (DARK + BRIGHT) / 2, atol=1e-12)
    np.testing.assert_array_equal(marked.reflectance(cells_mm + 0.5), plain.reflectance(cells_mm + 0.5))


def test_speckle_is_its_formula_summed_over_every_dot():
    rng = np.random.default_rng(5)
    count = rng.poisson(1.2, 64)
    cell = np.repeat(np.arange(64), count)
    centres = np.column_stack([cell % 8, cell // 8]) + rng.random((len(cell), 2))
    dots = np.column_stack([centres, rng.uniform(0.7, 1, len(cell)) ** -2])
    points_mm = rng.uniform(-0.3, 0.3, (300, 2))
    distance2 = np.sum((points_mm[:, None] / 0.1 + 4 - centres) ** 2, axis=2)
    darkness = 1.7 * np.clip(1 - distance2 * dots[:, 2], 0, None) ** 4
    expected = DARK + (BRIGHT - DARK) * np.exp(-darkness.sum(axis=1))
    speckle = Speckle(dots, np.concatenate([[0], np.cumsum(count)]), 0.1)
    np.testing.assert_allclose(speckle.reflectance(points_mm), expected, rtol=1e-12)


def test_the_surface_is_white_where_nothing_was_sprayed():
    far_mm = np.array([[25.0, 0.0], [-25.0, 3.0], [0.0, 21.0], [1e6, -1e6]])
    np.testing.assert_array_equal(Speckle.sprayed(1).reflectance(far_mm), BRIGHT)


def test_speckle_covers_half_of_the_surface_with_good_contrast():
    picture = speckle_picture()
    assert 0.4 < np.mean(picture < (DARK + BRIGHT) / 2) < 0.6
    assert picture.std() > 0.2


def test_a_speckle_is_four_to_six_pixels_across_in_both_directions():
    picture = speckle_picture()
    power = np.abs(np.fft.fft2(picture - picture.mean())) ** 2
    correlation = np.fft.ifft2(power).real / power.mean()
    for profile in (correlation[0], correlation[:, 0]):
        assert 4.0 < 2 * np.interp(0.5, -profile[:8] + 1, np.arange(8)) < 6.0


def test_speckle_has_no_trace_of_its_lattice_in_the_spectrum():
    picture = speckle_picture(700)
    # 125 cells: the lattice would be one sharp line, against a power that is spread exponentially.
    power = np.abs(np.fft.fft2(picture - picture.mean())) ** 2
    assert power[0, 125] + power[125, 0] < 20 * np.median(power[:5, 115:136])


def test_the_seed_decides_the_pattern():
    np.testing.assert_array_equal(speckle_picture(32, seed=7), speckle_picture(32, seed=7))
    assert np.abs(speckle_picture(32, seed=7) - speckle_picture(32, seed=8)).max() > 0.1
