from pathlib import Path

import h5py
import numpy as np
import pytest

from dic.calibration import Calibration
from dic.errors import CalibrationError
from dic.grid_points import GridPoints
from dic.pinhole import Pinhole

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
    saved.save(tmp_path / "cal.h5")
    read = Calibration.load(tmp_path / "cal.h5")
    px = np.random.default_rng(0).uniform(200, 600, (50, 2))

    assert np.array_equal(read.map(px), saved.map(px))
    assert np.array_equal(read.inside(px), saved.inside(px))
    assert (read.image_shape, read.source, read.grid.lines) == ((800, 900), "grid.png", (21, 19))
    assert read.grid.warnings == ("look out",)
    assert read.rms_mm == saved.rms_mm


def test_every_number_in_the_file_has_a_unit(tmp_path: Path) -> None:
    Calibration.fit(_grid(), (900, 900)).save(tmp_path / "cal.h5")
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
    Calibration.fit(_grid(), (900, 900)).save(path)
    path.write_bytes(path.read_bytes()[: int(share * path.stat().st_size)])

    with pytest.raises(CalibrationError, match=r"cal\.h5: read calibration"):
        Calibration.load(path)


def test_another_hdf5_file_is_refused(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "run.h5", "w") as file:
        file.attrs["file_format"] = "offaxis-run"

    with pytest.raises(CalibrationError, match="another kind"):
        Calibration.load(tmp_path / "run.h5")


def test_a_calibration_that_lacks_data_is_refused(tmp_path: Path) -> None:
    Calibration.fit(_grid(), (900, 900)).save(tmp_path / "cal.h5")
    with h5py.File(tmp_path / "cal.h5", "a") as file:
        del file["bicubic/scale_px"]

    with pytest.raises(CalibrationError, match="lacks"):
        Calibration.load(tmp_path / "cal.h5")


def test_a_place_that_cannot_be_written_is_named_and_nothing_is_left(tmp_path: Path) -> None:
    with pytest.raises(CalibrationError, match="write calibration"):
        Calibration.fit(_grid(), (900, 900)).save(tmp_path / "absent" / "cal.h5")
    assert list(tmp_path.iterdir()) == []
