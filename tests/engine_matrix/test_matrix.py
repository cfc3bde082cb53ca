"""Tests of every fault at every moment of a run, with the checks in `tests.engine_matrix.cells`."""

import pytest

from simulators.wire.faults import CAMERA, LOAD_FRAME, STAGE, names
from tests.engine_matrix.faults import FAULTS
from tests.engine_matrix.matrix import broken, documented, places, table, try_all
from tests.engine_matrix.runs import MOMENTS

SAMPLE = 11
"""The quick test tries one of this number of cells; the tried cells belong to all columns."""


def test_every_fault_of_the_rig_has_a_row_and_every_moment_a_column():
    rows = {fault.name.partition(":")[0] for fault in FAULTS}
    for device in (LOAD_FRAME, STAGE, CAMERA):
        assert {f"{device}.{name}" for name in names(device)} <= rows | {f"{CAMERA}.delay"}
    assert {column for _, column in places()} == set(range(len(MOMENTS)))


@pytest.mark.timeout(600)
def test_some_cells_of_every_column_keep_every_promise():
    cells = try_all(places()[::SAMPLE])
    assert {column for _, column in cells} == set(range(len(MOMENTS)))
    assert broken(cells) == []


@pytest.mark.long
@pytest.mark.timeout(3600)
def test_every_cell_keeps_every_promise_and_ends_as_documented():
    cells = try_all(places())
    assert broken(cells) == []
    # if a change is right: python -m tests.engine_matrix.matrix --write
    assert table(cells) == documented()
