"""The plot of characters shows the points of the curves where they belong."""

import numpy as np
import pytest

from rig.commands.char_plot import Cell, plot

TITLES = "strain, %", "stress, MPa"


def lines_of(cells: list[list[Cell]]) -> list[str]:
    return ["".join(sign for sign, _ in line) for line in cells]


def dots_of(lines: list[str]) -> set[tuple[int, int]]:
    """Return the places of all Braille dots, x to the right and y up, from the bits that Unicode defines."""
    order = {1: (0, 0), 2: (0, 1), 4: (0, 2), 8: (1, 0), 16: (1, 1), 32: (1, 2), 64: (0, 3), 128: (1, 3)}
    rows = [line.partition("│")[2] for line in lines if "│" in line]
    return {
        (2 * column + dx, 4 * (len(rows) - 1 - row) + 3 - dy)
        for row, line in enumerate(rows)
        for column, sign in enumerate(line)
        if 0x2800 <= ord(sign) < 0x2900
        for bit, (dx, dy) in order.items()
        if (ord(sign) - 0x2800) & bit
    }


def test_a_straight_line_from_corner_to_corner_has_a_dot_in_each_column_on_it():
    lines = lines_of(plot({"axial": [(0.0, 0.0), (8.0, 400.0)]}, 60, 20, TITLES, braille=True))
    assert lines[0] == "stress, MPa"
    assert lines[1].startswith("400 │")
    assert lines[-3].startswith("  0 │")
    assert lines[-1].split() == ["0", "strain,", "%", "8"]
    columns, rows = 2 * (60 - 5), 4 * (20 - 3)
    dots = dots_of(lines)
    # the mark of the newest point hides the dots of the last character
    assert {x for x, _ in dots} == set(range(columns - 2))
    assert all(abs(y - x * (rows - 1) / (columns - 1)) <= 1.0 for x, y in dots)
    assert lines[1].endswith("1")


def test_each_cell_belongs_to_its_curve_and_the_marks_tell_them_apart():
    curves = {"axial": [(0.0, 0.0), (1.0, 100.0)], "across": [(0.0, 0.0), (-1.0, 100.0)]}
    cells = plot(curves, 50, 12, TITLES, braille=True)
    for line in cells[1:-2]:
        middle = (line.index(("│", -1)) + len(line)) // 2
        assert {curve for _, curve in line[middle + 2 :]} <= {-1, 0}
        assert {curve for _, curve in line[line.index(("│", -1)) : middle - 2]} <= {-1, 1}
    signs = [sign for sign, curve in cells[1] if curve >= 0]
    assert (signs[0], signs[-1]) == ("2", "1")


@pytest.mark.parametrize(("columns", "rows"), [(30, 5), (60, 9), (119, 18)])
def test_no_line_is_wider_than_asked_for(columns, rows):
    wide = {"axial": [(-1.2345e-7, -98765.4), (3.3e-7, 4.2)]}
    lines = lines_of(plot(wide, columns, rows, TITLES, braille=True))
    assert len(lines) == rows
    assert max(map(len, lines)) <= columns


def test_a_terminal_without_braille_gets_ascii():
    lines = lines_of(plot({"axial": [(0.0, 0.0), (1.0, 1.0)]}, 40, 10, TITLES, braille=False))
    assert all(sign.isascii() for line in lines for sign in line)
    assert sum(line.count("*") for line in lines) >= 30


@pytest.mark.parametrize(
    "points", [[], [(np.nan, 1.0)], [(1.0, np.inf)], [(1e300, 0.0)], [(np.nan, np.nan)] * 3]
)
def test_points_that_no_plot_can_show_are_left_out(points):
    assert plot({"axial": points}, 60, 10, TITLES, braille=True) == []
    assert plot({"axial": [*points, (0.0, 0.0)]}, 60, 10, TITLES, braille=True) != []


def test_without_room_there_is_no_plot():
    assert plot({"axial": [(0.0, 0.0)]}, 29, 10, TITLES, braille=True) == []
    assert plot({"axial": [(0.0, 0.0)]}, 60, 4, TITLES, braille=True) == []
