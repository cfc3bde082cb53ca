"""The points of a curve whose fields are shown: a point without a strain is not replaced by another one."""

import numpy as np
import pytest

import dic
from dic.properties.curve import Curve
from dic.report.states import HALF, chosen_states
from dic.report.tensile_record import TensileColumn
from tests.dic.properties.synthetic import strain_of_stress

AREA_MM2 = 10.0
STRESS = np.concatenate(
    [np.linspace(0.0, 300.0, 120), np.linspace(301.0, 360.0, 60), np.linspace(359.0, 350.0, 10)]
)
STRAIN = strain_of_stress(np.concatenate([STRESS[:180], np.linspace(361.0, 370.0, 10)]), 70e3, 300.0, 12.0)
"""A bar with E = 70 GPa, Rp0.2 = 300 MPa and Rm = 360 MPa at the point 179."""


def column(strain=STRAIN, passed_n=None):
    """Return the column of a record, whose points are named by their numbers."""
    record = Curve("drawn", AREA_MM2 * STRESS, strain, passed_n=passed_n)
    found = dic.material_properties(record, dic.properties.PropertySettings(area_mm2=AREA_MM2))
    labels = tuple(f"image {k}" for k in range(len(STRESS)))
    return TensileColumn("", None, labels, ("",) * len(STRESS), found)


def lost():
    """Return the record of a gauge that is lost at 330 MPa."""
    return column(np.where(np.arange(len(STRAIN)) < 150, STRAIN, np.nan))


def passed():
    """Return a record that has no strain in the image of the largest load, 390 MPa."""
    loads = np.full((len(STRESS), 2), np.nan)
    loads[180] = 10.0 * 390.0
    return column(passed_n=loads)


def test_a_whole_record_has_the_points_of_rm_and_half_way():
    proof, half, rm = chosen_states(column())
    assert (rm.words, rm.label, rm.stress_mpa) == ("Rm", "image 179", pytest.approx(360.0))
    assert (proof.words, proof.stress_mpa) == ("Rp0,2", pytest.approx(300.0, abs=1.5))
    assert half.words == HALF
    assert half.strain == pytest.approx(0.5 * STRAIN[179], abs=np.diff(STRAIN)[:179].max())


@pytest.mark.parametrize(
    ("record", "reason"),
    [(lost, "the strain ends before the load; Rm comes later"), (passed, "has no strain")],
)
def test_without_a_strain_at_rm_no_other_point_is_shown_as_rm_or_half_way(record, reason):
    record = record()
    assert [state.words for state in chosen_states(record)] == ["Rp0,2"]
    for wanted in ("Rm", "half"):
        with pytest.raises(
            dic.errors.CurveError, match=f"fields at: expected a strain at Rm, got .*{reason}"
        ):
            chosen_states(record, [wanted])
    assert chosen_states(record, ["last"])[0].words == "last image"
