"""A calibration is read from its file with the same numbers, and other files are refused."""

from pathlib import Path

import h5py
import numpy as np
import pytest

from dic.calibration.calibration import Calibration, Model
from dic.calibration.file import load_calibration, save_calibration
from dic.errors import CalibrationError
from tests.dic.calibration.exact_grids import bent_grid, exact_grid
from tests.full_disk import full_disk


def test_a_saved_calibration_is_read_back_bit_by_bit(tmp_path: Path) -> None:
    saved = Calibration.fit(exact_grid((21, 19)), (800, 900), "grid.png")
    save_calibration(saved, tmp_path / "cal.h5")
    read = load_calibration(tmp_path / "cal.h5")
    px = np.random.default_rng(0).uniform(200, 600, (50, 2))

    assert np.array_equal(read.map(px), saved.map(px))
    assert np.array_equal(read.inside(px), saved.inside(px))
    assert (read.image_shape, read.source, read.grid.lines) == ((800, 900), "grid.png", (21, 19))
    assert read.grid.warnings == ("look out",)
    assert read.rms_mm == saved.rms_mm


def test_every_number_in_the_file_has_a_unit(tmp_path: Path) -> None:
    save_calibration(Calibration.fit(exact_grid(), (900, 900)), tmp_path / "cal.h5")
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
    save_calibration(Calibration.fit(exact_grid(), (900, 900)), path)
    path.write_bytes(path.read_bytes()[: int(share * path.stat().st_size)])

    with pytest.raises(CalibrationError, match=r"cal\.h5: read calibration"):
        load_calibration(path)


def test_an_hdf5_file_of_another_kind_is_refused(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "run.h5", "w") as file:
        file.attrs["file_format"] = "offaxis-run"

    with pytest.raises(CalibrationError, match="another kind"):
        load_calibration(tmp_path / "run.h5")


def test_a_calibration_that_lacks_data_is_refused(tmp_path: Path) -> None:
    save_calibration(Calibration.fit(exact_grid(), (900, 900)), tmp_path / "cal.h5")
    with h5py.File(tmp_path / "cal.h5", "a") as file:
        del file["bicubic/scale_px"]

    with pytest.raises(CalibrationError, match="lacks"):
        load_calibration(tmp_path / "cal.h5")


def test_a_place_that_cannot_be_written_is_named_and_nothing_is_left(tmp_path: Path) -> None:
    with pytest.raises(CalibrationError, match="write calibration"):
        save_calibration(Calibration.fit(exact_grid(), (900, 900)), tmp_path / "absent" / "cal.h5")
    assert list(tmp_path.iterdir()) == []


def test_a_full_disk_is_named_and_nothing_is_left(tmp_path: Path) -> None:
    calibration = Calibration.fit(exact_grid(), (900, 900))
    for most_bytes in (0, 5000):
        with full_disk(most_bytes), pytest.raises(CalibrationError) as refused:
            save_calibration(calibration, tmp_path / "cal.h5")
        assert str(refused.value) == (
            f"{tmp_path}/cal.h5: write calibration: expected a file that can be written, got File too large;"
            " choose another folder with -o, or free disk space"
        )
        assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("model", ["bicubic", "pinhole"])
def test_both_models_are_read_back(tmp_path: Path, model: Model) -> None:
    saved = Calibration.fit([bent_grid(0.01), exact_grid()], (900, 900)).using(model)
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
    saved = Calibration.fit(exact_grid(), (900, 900))
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
    save_calibration(Calibration.fit(exact_grid(), (900, 900)), tmp_path / "cal.h5")
    with h5py.File(tmp_path / "cal.h5", "a") as file:
        file.attrs["file_format_version"] = 3

    with pytest.raises(CalibrationError, match="version 3, newer"):
        load_calibration(tmp_path / "cal.h5")
