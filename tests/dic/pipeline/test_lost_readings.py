"""If images have no strain, properties without strain stay right, and other properties are withheld."""

import numpy as np
import pytest

from dic import material_properties
from dic.derived import gauge_curve
from dic.gauges import Extensometer, GaugeImage, GaugeSeries, Reading, TransverseExtensometer
from dic.properties import PropertySettings, with_shared_error

E_MPA, AREA_MM2 = 70e3, 20.0
GAUGES = (
    Extensometer(name="along", start=(1, 1), end=(1, 50), patch=5),
    TransverseExtensometer(name="across", start=(1, 1), end=(50, 1), patch=5, spread=20),
)
STRESS = np.concatenate(
    [np.linspace(0.0, 190.0, 80), np.linspace(192.0, 330.0, 90), np.linspace(329, 250, 30)]
)
RISING = STRESS[:170] / E_MPA + 0.002 * (STRESS[:170] / 200.0) ** 8
STRAIN = np.concatenate([RISING, RISING[-1] + 0.002 * np.arange(1, 31)])
"""Strain by the law of Ramberg and Osgood up to 330 MPa, and then of a necking specimen."""


def properties(lost=None, lost_across=None, std=1e-5):
    images = []
    for k, strain in enumerate(STRAIN):
        along, across = (
            Reading("mm", strain=value, strain_std=deviation, strain_std_images=1e-5)
            if where is None or not where[k]
            else Reading("mm", reason="few")
            for value, deviation, where in ((strain, 1e-5, lost), (-0.33 * strain, std, lost_across))
        )
        readings = {"along": {"calibrated": along}, "across": {"calibrated": across}}
        images.append(GaugeImage(f"i{k}", readings, {"load_n": AREA_MM2 * STRESS[k]}))
    read = gauge_curve(GaugeSeries("r", GAUGES, tuple(images)), "along", "across")
    found = material_properties(read.curve, PropertySettings(AREA_MM2))
    return read, with_shared_error(found, read.shared_std, read.shared_transverse, read.followed)


@pytest.mark.parametrize(
    ("lost", "word"), [(STRAIN > 0.06, "ends before"), ((STRAIN > 0.09) & (STRAIN < 0.14), "has no strain")]
)
def test_the_largest_load_counts_although_its_image_has_no_strain(lost, word):
    read, found = properties(lost)
    assert lost[169]
    assert found.values["Rm_mpa"].value == pytest.approx(330.0, rel=1e-12)
    assert found.values["E_gpa"].value == pytest.approx(70.0, rel=0.01)
    for name in ("Agt_percent", "Ag_percent"):
        assert found.values[name].value is None
        assert word in found.values[name].flags[0]
    assert read.left_out == np.count_nonzero(lost)


def test_a_lost_transverse_gauge_takes_nothing_from_the_axial_one():
    read, found = properties(lost_across=STRAIN > 0.02)
    assert (found.values["Rm_mpa"].value, read.left_out) == (pytest.approx(330.0), 0)
    assert found.values["Agt_percent"].value == pytest.approx(100 * RISING[-1], rel=0.01)
    assert found.values["nu"].value == pytest.approx(0.33, rel=1e-6)
    early = properties(lost_across=STRAIN < 0.0025)[1]
    assert "have a transverse strain" in early.values["nu"].flags[0]


def test_poissons_ratio_has_the_error_that_only_the_transverse_gauge_has():
    _, found = properties(std=3e-4)
    end = found.elastic.line.stop - 1
    # ν is the transverse strain over the axial strain.
    expected = np.sqrt(3e-4**2 - 1e-5**2) / STRAIN[end]
    assert found.strain_parts["nu"] == pytest.approx(expected, rel=0.1)
    assert found.values["nu"].std >= found.strain_parts["nu"]
