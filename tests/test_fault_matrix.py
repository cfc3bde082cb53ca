"""Every fault of the simulators on every driver; `tests.fault_matrix` says what must be so in each cell."""

import pytest

from simulators.faults import DEVICES, FAULTS, names
from tests.fault_columns import COLUMNS
from tests.fault_matrix import documented, rows, try_all


@pytest.fixture(scope="module")
def cells():
    """All cells, by column and row."""
    return {
        (name, form): cell for name, column in try_all().items() for form, cell in column.items()
    }  # fmt: skip


def test_every_fault_is_tried_on_every_device_that_can_have_it():
    assert {column.device for column in COLUMNS} == set(DEVICES)
    for column in COLUMNS:
        assert {form.partition(":")[0] for form in rows(column.device)} == set(names(column.device))
    assert all(fault.summary and fault.devices for fault in FAULTS.values())


def test_every_cell_ends_in_the_right_error_and_as_documented(cells):
    broken = [f"{name}, {form}: {mistake}" for (name, form), cell in cells.items() for mistake in cell.broken]
    assert broken == []
    found = {name: {} for name, _ in cells}
    for (name, form), cell in cells.items():
        found[name][form] = str(cell)
    # if the change is right: python -m tests.fault_matrix --write
    assert {name: documented(name) for name in found} == found
