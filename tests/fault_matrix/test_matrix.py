"""Tests of every fault of the simulators with every driver; `tests.fault_matrix.matrix` has the checks."""

import pytest

from simulators.wire.faults import DEVICES, FAULTS, names
from tests.fault_matrix.columns import COLUMNS
from tests.fault_matrix.matrix import LIES, documented, rows, try_all

EVERY = 6
"""The quick test tries one of this number of faults with each driver, beginning at another one for each."""


def test_every_fault_is_tried_on_every_device_that_can_have_it():
    assert {column.device for column in COLUMNS} == set(DEVICES)
    for column in COLUMNS:
        assert {form.partition(":")[0] for form in rows(column.device)} == set(names(column.device)) - LIES
    assert all(fault.summary and fault.devices for fault in FAULTS.values())


def test_a_sample_of_cells_ends_in_the_right_error_and_as_documented():
    check(try_all(EVERY, at_a_time=2))


@pytest.mark.extended
def test_every_cell_ends_in_the_right_error_and_as_documented():
    cells = try_all()
    check(cells)
    assert {name: set(column) for name, column in documented().items()} == {
        name: set(column) for name, column in cells.items()
    }


def check(cells):
    """Check cells of the matrix, given by the names of column and row."""
    broken = [
        f"{name}, {form}: {mistake}"
        for name, column in cells.items()
        for form, cell in column.items()
        for mistake in cell.broken
    ]
    assert broken == []
    # if the change is right: python -m tests.fault_matrix.matrix --write
    known = documented()
    assert {name: {form: str(cell) for form, cell in column.items()} for name, column in cells.items()} == {
        name: {form: known[name].get(form) for form in column} for name, column in cells.items()
    }
