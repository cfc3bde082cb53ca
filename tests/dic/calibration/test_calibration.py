import numpy as np
import pytest

from dic.calibration.bicubic import BicubicMap
from dic.calibration.calibration import Calibration
from dic.calibration.pinhole.camera import Pinhole
from dic.calibration.pinhole.fit import fit_pinhole
from dic.errors import CalibrationError
from dic.targets.points import GridPoints
from tests.dic.calibration.exact_grids import CAMERA, bent_grid, exact_grid


def test_pixels_map_to_the_millimetres_they_came_from() -> None:
    calibration = Calibration.fit(exact_grid(), (900, 900), "grid.png")
    mm = np.random.default_rng(0).uniform(-5, 5, (300, 2))
    error_mm = np.linalg.norm(calibration.map(CAMERA.project(mm)) - mm, axis=1)

    # the paper's 0.0149 px at 30°, at 70 px/mm at the centre and 54 at the far side
    assert error_mm.max() < 0.0149 / 54


def test_residuals_in_pixels_are_the_paper_s_for_30_degrees() -> None:
    calibration = Calibration.fit(exact_grid(), (900, 900))

    assert calibration.max_px == pytest.approx(1.49e-2, rel=0.01)
    assert np.linalg.norm(calibration.residual_px, axis=1).mean() == pytest.approx(5.7e-3, rel=0.01)
    assert calibration.rms_px <= calibration.max_px


def test_scale_is_that_of_the_lens_and_the_slant() -> None:
    calibration = Calibration.fit(exact_grid(), (900, 900))

    # 40 mm / 2800 px across, and 1/cos 30° more along the slant; geometric mean
    assert calibration.mm_per_px == pytest.approx(40 / 2800 / np.sqrt(np.cos(np.pi / 6)), rel=0.01)
    along_slant = 40 / 2800 / np.cos(np.pi / 6)
    assert sorted(calibration.axes_mm_per_px) == pytest.approx([40 / 2800, along_slant], rel=0.01)


def test_points_beyond_the_outermost_lines_are_outside() -> None:
    calibration = Calibration.fit(exact_grid(), (900, 900))
    mm = np.array([[4.9, 4.9], [-4.9, -4.9], [0, 0], [5.1, 0], [0, -5.1], [-5.1, 5.1], [9, 9]])
    inside = calibration.inside(CAMERA.project(mm))

    assert inside.tolist() == [True, True, True, False, False, False, False]


def test_a_place_that_is_not_a_number_is_outside() -> None:
    assert not Calibration.fit(exact_grid(), (900, 900)).inside(np.array([[np.nan, np.nan]])).any()


def test_the_area_shrinks_where_an_outer_point_was_not_found() -> None:
    calibration = Calibration.fit(exact_grid(missing=((20, 20),)), (900, 900))
    corner = CAMERA.project(np.array([[4.9, 4.9], [4.7, 4.7]]))

    assert calibration.inside(corner).tolist() == [False, True]


def test_the_paper_s_map_is_the_one_in_use_unless_another_is_asked_for() -> None:
    calibration = Calibration.fit(bent_grid(), (900, 900))
    pinhole = calibration.using("pinhole")
    at = np.array([[300.0, 500.0]])

    assert calibration.model == "bicubic"
    assert np.array_equal(calibration.map(at), calibration.bicubic.map(at))
    assert pinhole.pinhole is not None
    assert np.array_equal(pinhole.map(at), pinhole.pinhole.map(at))
    assert np.array_equal(pinhole.jacobian(at), pinhole.pinhole.jacobian(at))
    assert np.array_equal(pinhole.inside(at), calibration.inside(at))
    assert pinhole.rms_px < 1e-6 < 0.02 < calibration.rms_px


def test_the_model_that_predicts_left_out_points_better_is_recommended_with_the_reason() -> None:
    bent = Calibration.fit(bent_grid(), (900, 900))
    noisy = Calibration.fit(_straight(0.01), (900, 900))

    assert bent.recommended == "pinhole"
    bicubic_px = bent.bicubic_cross_validation_px
    sentence = f"pinhole: predicts left-out points to 0.0000 px, bicubic to {bicubic_px:.4f} px"
    assert bent.recommendation == sentence
    # what was left out is missed by more than what was fitted
    assert bent.bicubic_cross_validation_px > bent.rms_px
    # straight on and with noise both do as well
    assert noisy.recommended == "bicubic"
    assert "without a clear difference" in noisy.recommendation


def _straight(noise_px: float) -> GridPoints:
    px = Pinhole.swung(principal_px=(450, 450)).project(exact_grid().xy_mm)
    px += np.random.default_rng(1).normal(0, noise_px, px.shape)
    return GridPoints.on_lattice(exact_grid().index, px, (21, 21), 0.5)


def test_without_a_pinhole_model_the_reason_is_given_and_the_bicubic_map_serves() -> None:
    # the grid's mirror image: no camera sees it
    grid = exact_grid()
    mirrored = GridPoints.on_lattice(grid.index, grid.uv_px * [-1, 1] + [900, 0], (21, 21), 0.5)
    calibration = Calibration.fit(mirrored, (900, 900))

    assert calibration.pinhole is None
    assert calibration.max_px < 0.02
    assert calibration.recommendation.startswith("bicubic: there is no pinhole model (fit lens and pose")
    with pytest.raises(CalibrationError, match="use the pinhole model"):
        calibration.using("pinhole")


def test_a_grid_too_small_to_leave_points_out_still_calibrates() -> None:
    calibration = Calibration.fit(exact_grid((4, 4)), (900, 900))

    assert np.isnan(calibration.bicubic_cross_validation_px)
    assert "needs more lines" in calibration.recommendation


@pytest.mark.parametrize("model", ["bicubic", pytest.param("pinhole", marks=pytest.mark.extended)])
def test_the_map_s_errors_are_those_that_scattered_grid_points_cause(model: str) -> None:
    at = np.array([[450.0, 450.0], [250.0, 600.0], [700.0, 300.0]])
    exact = _straight(0.0)
    clean = Pinhole.swung(principal_px=(450, 450)).map(at)
    rng = np.random.default_rng(3)
    errors, said = [], []
    for _ in range(60):
        px = exact.uv_px + rng.normal(0, 0.05, exact.uv_px.shape)
        grid = GridPoints.on_lattice(exact.index, px, (21, 21), 0.5)
        one: BicubicMap | Pinhole = (
            BicubicMap.fit(px, grid.xy_mm) if model == "bicubic" else fit_pinhole(grid, (900, 900), k2=False)
        )
        errors.append(one.map(at) - clean)
        said.append((one.error_factors(at) ** 2).sum(axis=2))
    seen = np.sqrt(np.mean(np.square(errors), axis=0))

    # 60 repetitions tell a deviation to 9 %; 0.05 px of noise is more than three quarters of it gone in a fit
    assert seen == pytest.approx(np.sqrt(np.mean(said, axis=0)), rel=0.3)
    assert seen.max() < 0.05 / 70 / 2
