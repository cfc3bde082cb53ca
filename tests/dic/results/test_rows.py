"""In a growing dataset of a result file, every row is at its place for any number of rows."""

import h5py
import numpy as np
import pytest

from dic.results.rows import PENDING_MAX, Rows


@pytest.mark.parametrize("count", [1, PENDING_MAX - 1, PENDING_MAX, 3 * PENDING_MAX + 5])
def test_single_values_texts_and_arrays_are_read_back_in_their_rows(tmp_path, count):
    with h5py.File(tmp_path / "rows.h5", "w") as file:
        rows = Rows()
        for n in range(count):
            values = {"exx": 0.5 * n, "label": f"image {n}", "applied": n % 3 == 0, "U_mm": np.full(4, n)}
            rows.append(file, n, values)
        rows.finish()
    with h5py.File(tmp_path / "rows.h5") as file:
        assert file["exx"][:].tolist() == [0.5 * n for n in range(count)]
        assert file["label"].asstr()[:].tolist() == [f"image {n}" for n in range(count)]
        assert file["applied"][:].tolist() == [n % 3 == 0 for n in range(count)]
        assert file["U_mm"][:].tolist() == [[n] * 4 for n in range(count)]
        assert file["U_mm"].attrs["units"] == "mm"


@pytest.mark.parametrize("first", [3, PENDING_MAX + 3])
def test_rows_before_a_late_value_are_empty(tmp_path, first):
    count = first + PENDING_MAX + 3
    with h5py.File(tmp_path / "rows.h5", "w") as file:
        rows = Rows()
        for n in range(count):
            late = {"shift_mm": 1.0 * n, "reason": "late", "heights_mm": np.ones(2)} if n >= first else {}
            rows.append(file, n, {"exx": 0.0} | late)
        assert rows.holds(file, "shift_mm")
        assert not rows.holds(file, "slope_x_deg")
        rows.finish()
    with h5py.File(tmp_path / "rows.h5") as file:
        assert np.isnan(file["shift_mm"][:first]).all()
        assert np.isnan(file["heights_mm"][:first]).all()
        assert set(file["reason"].asstr()[:first]) == {""}
        np.testing.assert_array_equal(file["shift_mm"][first:], np.arange(first, count))


def test_rows_that_are_elsewhere_take_no_space(tmp_path):
    with h5py.File(tmp_path / "rows.h5", "w") as file:
        rows = Rows()
        for n in range(9):
            rows.append(file, n, {"U_mm": np.zeros((100, 100))}, write=False)
        rows.finish()
        assert len(file["U_mm"]) == 9
    assert (tmp_path / "rows.h5").stat().st_size < 20_000


@pytest.mark.parametrize("shape", [(4, 5), (2, 3), (3, 4, 1)])
def test_a_row_of_another_shape_is_refused(tmp_path, shape):
    with h5py.File(tmp_path / "rows.h5", "w") as file:
        rows = Rows()
        rows.append(file, 0, {"U_mm": np.ones((3, 4))})
        with pytest.raises(ValueError, match="U_mm"):
            rows.append(file, 1, {"U_mm": np.ones(shape)})
