"""The calibration target that a protocol declares."""

import tomllib

import pytest

from rig.protocol.protocol import parse_protocol
from tests.places import example
from tests.rig.protocol.test_phases import HOLD, PULLING, mistakes, protocol


@pytest.mark.parametrize(
    ("grid", "counts"),
    [
        ('target = "checkerboard"\nsquares_x = 12\nsquares_y = 9\npitch_mm = 1.0', (12, 9)),
        ('target = "charuco"\nsquares_x = 7\nsquares_y = 5\npitch_mm = 2.0\nmarker_mm = 1.4', (7, 5)),
        ('target = "dots"\ndots_x = 15\ndots_y = 15\npitch_mm = 0.5', (15, 15)),
        ('target = "asymmetric-dots"\ndots_x = 4\ndots_y = 11\npitch_mm = 2.0', (4, 11)),
        ("lines_x = 11", (11, 21)),
    ],
)
def test_any_target_can_be_the_grid_of_any_protocol(grid, counts):
    made = protocol(HOLD, PULLING + f"[grid]\n{grid}\n")
    assert made.grid.counts == counts
    edited = tomllib.loads(example("rotation"))
    edited["grid"] = tomllib.loads(grid)
    assert parse_protocol(edited).grid.counts == counts


def test_an_unknown_target_is_told_all_that_are_known(tmp_path):
    found = mistakes(tmp_path, HOLD, PULLING + '[grid]\ntarget = "stars"\n')
    assert "'lines', 'checkerboard', 'charuco', 'dots' or 'asymmetric-dots' is expected" in found


def test_an_asymmetric_grid_needs_enough_dots_to_be_found(tmp_path):
    table = 'target = "asymmetric-dots"\ndots_x = 3\ndots_y = 5\npitch_mm = 2.0\n'
    found = mistakes(tmp_path, HOLD, PULLING + f"[grid]\n{table}")
    assert "grid: dots_x × dots_y must be at least 16 dots, got 3 × 5" in found
