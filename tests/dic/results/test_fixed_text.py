"""Lines of a table as bytes at once: their decimals are those of exact decimal arithmetic."""

import csv
from dataclasses import replace
from decimal import ROUND_HALF_EVEN, Decimal

import numpy as np
import pytest

from dic.results.csv import write_csv
from dic.results.fixed_text import FixedLines
from dic.strain.measurement import measure
from tests.dic.results.test_csv import field


def exact(value: float, digits: int) -> str:
    """Return a number with its decimals rounded exactly; 0 has no sign, and NaN is empty."""
    if value != value:
        return ""
    rounded = Decimal(value).quantize(Decimal(1).scaleb(-digits), ROUND_HALF_EVEN)
    return f"{abs(rounded) if rounded == 0 else rounded:f}"


@pytest.mark.parametrize(("digits", "point"), [(6, "."), (7, ","), (9, "."), (4, "."), (3, ".")])
def test_numbers_have_exactly_rounded_decimals(digits, point):
    rng = np.random.default_rng(digits)
    spread = rng.normal(size=(4000, 3)) * 10.0 ** rng.uniform(-12, 3.2, (4000, 3))
    near = (rng.integers(-50_000, 50_000, (1000, 3)) + 0.5) * 10.0**-digits  # near the middle of two decimals
    special = np.array(
        [[0.0, -0.0, np.nan], [-1e-12, 9998.0, -9998.0], [1.0, -1.0, 0.1], [5e-324, 999.0, 1e3]]
    )
    values = np.concatenate([spread, near, special])
    lines = FixedLines(len(values), ";", point)
    lines.add_texts(["", "first"], np.arange(len(values)) % 2)
    lines.add_numbers(values, digits)
    lines.add_texts(["end"], np.zeros(len(values), int))
    written = lines.joined().decode().split("\r\n")
    assert written.pop() == ""
    assert len(written) == len(values)
    assert not lines.doubtful[:4000].any()
    for k in np.flatnonzero(~lines.doubtful):
        cells = ["first" * (k % 2), *(exact(value, digits).replace(".", point) for value in values[k]), "end"]
        assert written[k] == ";".join(cells)


def test_lines_that_python_must_write_are_known():
    """Values in the middle between two decimals, and values too large for a cell."""
    middle = 2.0**-7  # 0.0078125
    lines = FixedLines(5, ",", ".")
    lines.add_numbers(np.array([[middle], [middle * 1.01], [1e5], [np.inf], [np.nan]]), 6)
    assert lines.doubtful.tolist() == [True, False, True, True, False]


@pytest.mark.parametrize("shift", [2.0**-7, 123456.789, -(2.0**-7)])
def test_a_table_with_such_numbers_is_rounded_exactly_too(tmp_path, shift):
    moved = field()
    moved.warps[..., 0] += shift
    write_csv(measure(replace(moved)), tmp_path / "points.csv")
    with (tmp_path / "points.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    expected = [exact(value, 6) for value in moved.u_px.ravel().tolist()]
    assert [row["u_px"] for row in rows] == expected
    assert expected[24] == exact(shift, 6)
