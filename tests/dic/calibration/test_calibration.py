from pathlib import Path

import h5py
import numpy as np
import pytest

from dic.calibration.bicubic import BicubicMap
from dic.calibration.calibration import Calibration, Model
from dic.calibration.file import load_calibration, save_calibration
from dic.calibration.pinhole.camera import Pinhole
from dic.calibration.pinhole.fit import fit_pinhole
from dic.errors import CalibrationError
from dic.targets.points import GridPoints
from simulators.scene.optics import PinholeCamera

CAMERA = Pinhole.swung(pan_deg=30, principal_px=(450, 450))


def _grid(lines: tuple[int, int] = (21, 21), missing: tuple[tuple[int, int], ...] = ()) -> GridPoints:
    index = np.array([(i, j) for j in range(lines[1]) for i in range(lines[0]) if (i, j) not in missing])
    lattice = GridPoints.on_lattice(index, np.empty((len(index), 2)), lines, 0.5)
    return GridPoints.on_lattice(index, CAMERA.project(lattice.xy_mm), lines, 0.5, ("look out",))


def test_pixels_map_to_the_millimetres_they_came_from() -> None:
    calibration = Calibration.fit(_grid(), (900, 900), "grid.png")
    mm = np.random.default_rng(0).uniform(-5, 5, (300, 2))
    error_mm = np.linalg.norm(calibration.map(CAMERA.project(mm)) - mm, axis=1)

    # the paper's 0.0149 px at 30°, at 70 px/mm at the centre and 54 at the far side
    assert error_mm.max() < 0.0149 / 54


def test_residuals_in_pixels_are_the_paper_s_for_30_degrees() -> None:
    calibration = Calibration.fit(_grid(), (900, 900))

    assert calibration.max_px == pytest.approx(1.49e-2, rel=0.01)
    assert np.linalg.norm(calibration.residual_px, axis=1).mean() == pytest.approx(5.7e-3, rel=0.01)
    assert calibration.rms_px <= calibration.max_px


def test_scale_is_that_of_the_lens_and_the_slant() -> None:
    calibration = Calibration.fit(_grid(), (900, 900))

    # 40 mm / 2800 px across, and 1/cos 30° more along the slant; geometric mean
    assert calibration.mm_per_px == pytest.approx(40 / 2800 / np.sqrt(np.cos(np.pi / 6)), rel=0.01)


def test_points_beyond_the_outermost_lines_are_outside() -> None:
    calibration = Calibration.fit(_grid(), (900, 900))
    mm = np.array([[4.9, 4.9], [-4.9, -4.9], [0, 0], [5.1, 0], [0, -5.1], [-5.1, 5.1], [9, 9]])
    inside = calibration.inside(CAMERA.project(mm))

    assert inside.tolist() == [True, True, True, False, False, False, False]


def test_nowhere_is_outside() -> None:
    assert not Calibration.fit(_grid(), (900, 900)).inside(np.array([[np.nan, np.nan]])).any()


def test_the_area_shrinks_where_an_outer_point_was_not_found() -> None:
    calibration = Calibration.fit(_grid(missing=((20, 20),)), (900, 900))
    corner = CAMERA.project(np.array([[4.9, 4.9], [4.7, 4.7]]))

    assert calibration.inside(corner).tolist() == [False, True]


def test_a_saved_calibration_is_read_back_bit_by_bit(tmp_path: Path) -> None:
    saved = Calibration.fit(_grid((21, 19)), (800, 900), "grid.png")
    save_calibration(saved, tmp_path / "cal.h5")
    read = load_calibration(tmp_path / "cal.h5")
    px = np.random.default_rng(0).uniform(200, 600, (50, 2))

    assert np.array_equal(read.map(px), saved.map(px))
    assert np.array_equal(read.inside(px), saved.inside(px))
    assert (read.image_shape, read.source, read.grid.lines) == ((800, 900), "grid.png", (21, 19))
    assert read.grid.warnings == ("look out",)
    assert read.rms_mm == saved.rms_mm


def test_every_number_in_the_file_has_a_unit(tmp_path: Path) -> None:
    save_calibration(Calibration.fit(_grid(), (900, 900)), tmp_path / "cal.h5")
    without = []
    with h5py.File(tmp_path / "cal.h5") as file:
        file.visititems(
            lambda name, item: (
                without.append(name) if isinstance(item, h5py.Dataset) and "units" not in item.attrs else None
            )
        )

    assert without == []


@pytest.mark.parametrize("share", [0.0, 0.2, 0.6, 0.95])
def test_a_calibration_file_that_was_cut_off_is_refused(tmp_path: Path, share: float) -> None:
    path = tmp_path / "cal.h5"
    save_calibration(Calibration.fit(_grid(), (900, 900)), path)
    path.write_bytes(path.read_bytes()[: int(share * path.stat().st_size)])

    with pytest.raises(CalibrationError, match=r"cal\.h5: read calibration"):
        load_calibration(path)


def test_another_hdf5_file_is_refused(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "run.h5", "w") as file:
        file.attrs["file_format"] = "offaxis-run"

    with pytest.raises(CalibrationError, match="another kind"):
        load_calibration(tmp_path / "run.h5")


def test_a_calibration_that_lacks_data_is_refused(tmp_path: Path) -> None:
    save_calibration(Calibration.fit(_grid(), (900, 900)), tmp_path / "cal.h5")
    with h5py.File(tmp_path / "cal.h5", "a") as file:
        del file["bicubic/scale_px"]

    with pytest.raises(CalibrationError, match="lacks"):
        load_calibration(tmp_path / "cal.h5")


def test_a_place_that_cannot_be_written_is_named_and_nothing_is_left(tmp_path: Path) -> None:
    with pytest.raises(CalibrationError, match="write calibration"):
        save_calibration(Calibration.fit(_grid(), (900, 900)), tmp_path / "absent" / "cal.h5")
    assert list(tmp_path.iterdir()) == []


def _bent(noise_px: float = 0.0) -> GridPoints:
    """Return grid points of a camera whose lens bends more than bicubic surfaces can follow."""
    camera = PinholeCamera(900, 900, pan_deg=25, tilt_deg=25, k1_per_px2=1e-7)
    xy = _grid().xy_mm
    uv = camera.project(np.column_stack([xy, np.zeros(len(xy))]))
    uv += np.random.default_rng(0).normal(0, 1, uv.shape) * noise_px
    return GridPoints.on_lattice(_grid().index, uv, (21, 21), 0.5)


def test_the_paper_s_map_is_the_one_in_use_unless_another_is_asked_for() -> None:
    calibration = Calibration.fit(_bent(), (900, 900))
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
    bent = Calibration.fit(_bent(), (900, 900))
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
    px = Pinhole.swung(principal_px=(450, 450)).project(_grid().xy_mm)
    px += np.random.default_rng(1).normal(0, noise_px, px.shape)
    return GridPoints.on_lattice(_grid().index, px, (21, 21), 0.5)


def test_without_a_pinhole_model_the_reason_is_given_and_the_bicubic_map_serves() -> None:
    # the grid's mirror image: no camera sees it
    grid = _grid()
    mirrored = GridPoints.on_lattice(grid.index, grid.uv_px * [-1, 1] + [900, 0], (21, 21), 0.5)
    calibration = Calibration.fit(mirrored, (900, 900))

    assert calibration.pinhole is None
    assert calibration.max_px < 0.02
    assert calibration.recommendation.startswith("bicubic: there is no pinhole model (fit lens and pose")
    with pytest.raises(CalibrationError, match="use the pinhole model"):
        calibration.using("pinhole")


def test_a_grid_too_small_to_leave_points_out_still_calibrates() -> None:
    calibration = Calibration.fit(_grid((4, 4)), (900, 900))

    assert np.isnan(calibration.bicubic_cross_validation_px)
    assert "needs more lines" in calibration.recommendation


@pytest.mark.parametrize("model", ["bicubic", "pinhole"])
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


@pytest.mark.parametrize("model", ["bicubic", "pinhole"])
def test_both_models_are_read_back(tmp_path: Path, model: Model) -> None:
    saved = Calibration.fit([_bent(0.01), _grid()], (900, 900)).using(model)
    save_calibration(saved, tmp_path / "cal.h5")
    read = load_calibration(tmp_path / "cal.h5")
    px = np.random.default_rng(0).uniform(200, 600, (50, 2))

    assert read.model == model
    assert np.array_equal(read.map(px), saved.map(px))
    assert np.array_equal(read.error_factors(px), saved.error_factors(px))
    assert saved.pinhole is not None
    assert read.pinhole is not None
    assert np.array_equal(read.pinhole.covariance, saved.pinhole.covariance)
    assert read.pinhole.off_axis_deg == saved.pinhole.off_axis_deg
    assert (read.recommendation, read.images) == (saved.recommendation, 2)
    with h5py.File(tmp_path / "cal.h5") as file:
        assert np.array_equal(file["pinhole/residual_px"], saved.residuals["pinhole"].px)
        assert np.array_equal(file["bicubic/residual_mm"], saved.residuals["bicubic"].mm)


def test_a_file_of_the_first_version_is_still_read(tmp_path: Path) -> None:
    saved = Calibration.fit(_grid(), (900, 900))
    save_calibration(saved, tmp_path / "cal.h5")
    with h5py.File(tmp_path / "cal.h5", "a") as file:
        file.attrs["file_format_version"] = 1
        for name in ("model", "recommendation", "pinhole_problem"):
            del file.attrs[name]
        for name in ("pinhole", "images", "bicubic/coefficient_errors", "bicubic/left_out_px"):
            del file[name]
    read = load_calibration(tmp_path / "cal.h5")

    assert np.array_equal(read.residual_px, saved.residual_px)
    assert read.pinhole is None
    assert "version 1" in read.recommendation


def test_a_file_of_a_version_to_come_is_refused(tmp_path: Path) -> None:
    save_calibration(Calibration.fit(_grid(), (900, 900)), tmp_path / "cal.h5")
    with h5py.File(tmp_path / "cal.h5", "a") as file:
        file.attrs["file_format_version"] = 3

    with pytest.raises(CalibrationError, match="version 3, newer"):
        load_calibration(tmp_path / "cal.h5")
