"""Tests of the mean strain ratio and the planar anisotropy, with strain ratios of virtual specimens."""

import numpy as np
import pytest

from dic import material_properties
from dic.errors import CurveError
from dic.properties import Curve, PropertySettings, PropertyValue, planar_anisotropy
from simulators.scene.specimen import SimulatedSpecimen, SpecimenSettings

RATIOS = {0: 1.8, 45: 1.3, 90: 2.2}  # a deep-drawing steel


def value(number, std=0.0, flags=()):
    return PropertyValue(number, std, "1", "rule", {}, flags)


def measured(ratio):
    """Return the strain ratio that is measured on a virtual specimen with the given ratio, without noise."""
    steel = {"law": "swift", "strength_mpa": 560.0, "offset_strain": 0.003, "exponent": 0.24}
    settings = SpecimenSettings.model_validate(
        {"hardening": steel, "youngs_modulus_mpa": 205_000.0, "strain_ratio": ratio, "fracture_strain": 0.3}
    )
    specimen, rows = SimulatedSpecimen(settings), []
    for displacement_mm in np.concatenate([np.arange(0.002, 0.5, 0.002), np.arange(0.5, 14.0, 0.05)]):
        load_n = specimen.stretch_to(displacement_mm)
        rows.append((load_n, specimen.state.axial_strain, specimen.state.transverse_strain))
    curve = Curve("steel", *np.array(rows).T)
    return material_properties(curve, PropertySettings(area_mm2=settings.area_mm2)).values["r"]


def test_tests_in_three_directions_give_the_anisotropy_of_the_sheet():
    found = planar_anisotropy({direction: measured(ratio) for direction, ratio in RATIOS.items()})
    assert found["r_mean"].value == pytest.approx((1.8 + 2 * 1.3 + 2.2) / 4, rel=0.01)
    assert found["delta_r"].value == pytest.approx((1.8 + 2.2) / 2 - 1.3, rel=0.02)


def test_errors_of_the_three_tests_add_as_independent_ones():
    found = planar_anisotropy(
        {0: value(1.8, 0.03), 45: value(1.3, 0.02), 90: value(2.2, 0.04, ("slack: x",))}
    )
    # Monte Carlo of the two formulas, known to 0.5 %
    drawn = np.random.default_rng(1).normal([1.8, 1.3, 2.2], [0.03, 0.02, 0.04], (40_000, 3))
    mean = (drawn[:, 0] + 2 * drawn[:, 1] + drawn[:, 2]) / 4
    delta = (drawn[:, 0] + drawn[:, 2]) / 2 - drawn[:, 1]
    assert found["r_mean"].std == pytest.approx(mean.std(), rel=0.02)
    assert found["delta_r"].std == pytest.approx(delta.std(), rel=0.02)
    assert found["r_mean"].flags == ("at 90°, slack: x",)


def test_a_missing_ratio_leaves_both_without_a_value():
    found = planar_anisotropy({0: value(1.8), 45: value(None, None, ("missing: no width",)), 90: value(2.2)})
    assert found["r_mean"].value is None
    assert "no strain ratio at 45°: missing: no width" in found["delta_r"].flags[0]


def test_other_directions_are_refused():
    with pytest.raises(CurveError, match="expected tests at 0°, 45° and 90°, got"):
        planar_anisotropy({0: value(1.8), 90: value(2.2)})
