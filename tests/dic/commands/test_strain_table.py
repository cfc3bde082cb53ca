"""In the printed table of strains, each value is below its heading."""

import math

import pytest

from dic.commands.strain_table import Column, StrainTable

KNOWN = {"exx": 0.001234, "eyy": -0.000567, "exy": 0.000089}


@pytest.fixture
def table():
    return StrainTable([Column("image", 8, number=False)])


@pytest.mark.parametrize("unknown", [(), ("exx",), ("eyy",), ("exx", "eyy"), ("exy",)])
@pytest.mark.parametrize("missing", [None, math.nan])
@pytest.mark.parametrize("stds", [{}, {"exx_std": 3.1e-6, "eyy_std": 12e-6, "exy_std": 250e-6}])
def test_a_value_is_below_its_heading_although_others_are_not_known(table, unknown, missing, stds):
    (line,) = table.lines(["a.png"], {"raw": KNOWN | stds | dict.fromkeys(unknown, missing)})
    for name, strain in KNOWN.items():
        end = table.heading().index(name) + len(name)
        if name in unknown:
            assert line[end - len(name) : end].strip() == ""
        else:
            assert float(line[:end].split()[-1]) == pytest.approx(1e6 * strain)
            assert line[end - 1].isdigit()


def test_a_kind_of_strain_without_any_value_has_no_line(table):
    (line,) = table.lines(["a.png"], {"raw": dict.fromkeys(KNOWN), "calibrated": KNOWN})
    assert "calibrated" in line
    assert table.lines(["a.png"], {"raw": dict.fromkeys(KNOWN)}) == ["a.png    no mean strain"]
