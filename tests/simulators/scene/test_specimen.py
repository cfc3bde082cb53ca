import numpy as np
import pytest
from pydantic import ValidationError

from simulators.scene.specimen import SimulatedSpecimen, SpecimenSettings


def displacement_for(load_n, **settings):
    """Return the displacement at which a new specimen reaches a load, by bisection."""
    low, high = 0.0, 20.0
    for _ in range(60):
        middle = (low + high) / 2
        if SimulatedSpecimen(SpecimenSettings(**settings)).stretch_to(middle) < load_n:
            low = middle
        else:
            high = middle
    return high


def stretched_to_load(load_n):
    specimen = SimulatedSpecimen(SpecimenSettings(fracture_strain=0.9))
    specimen.stretch_to(displacement_for(load_n, fracture_strain=0.9))
    return specimen


def test_small_loads_stretch_it_by_hooke_and_poisson():
    specimen = stretched_to_load(4000.0)
    assert specimen.state.axial_strain == pytest.approx(4000 / 25 / 73_100, abs=1e-6)
    assert specimen.state.transverse_strain == pytest.approx(-0.33 * 4000 / 25 / 73_100, abs=1e-6)
    np.testing.assert_allclose(
        specimen.state.deformation_gradient(),
        [[1 + specimen.state.transverse_strain, 0], [0, 1 + specimen.state.axial_strain]],
    )


def test_yield_stress_leaves_two_per_mille():
    assert stretched_to_load(345 * 25).state.axial_strain == pytest.approx(345 / 73_100 + 0.002, abs=1e-8)


def test_ultimate_stress_is_reached_at_the_ultimate_strain():
    assert stretched_to_load(483 * 25).state.axial_strain == pytest.approx(0.15, abs=1e-6)


def test_five_millimetres_of_grip_give_a_plausible_curve():
    specimen = SimulatedSpecimen(SpecimenSettings())
    displacement_mm = np.linspace(0, 5, 251)
    load_n = np.array([specimen.stretch_to(u) for u in displacement_mm])
    stiffness = np.diff(load_n) / np.diff(displacement_mm)
    assert 0.05 < specimen.state.axial_strain < 0.07
    assert 345 * 25 < load_n[-1] < 483 * 25
    assert np.all(stiffness > 0)
    assert stiffness[0] < 0.5 * stiffness.max()
    assert stiffness[-1] < 0.1 * stiffness.max()


def test_unloading_is_elastic_and_leaves_the_plastic_strain():
    specimen = SimulatedSpecimen(SpecimenSettings(machine_stiffness_n_mm=15_000.0))
    top_n = specimen.stretch_to(3.0)
    strain_at_top = specimen.state.axial_strain
    lower_n = specimen.stretch_to(2.9)
    series_mm_per_n = 60 / (73_100 * 25) + 1 / 15_000
    assert top_n - lower_n == pytest.approx(0.1 / series_mm_per_n)
    assert strain_at_top - specimen.state.axial_strain == pytest.approx((top_n - lower_n) / 25 / 73_100)
    assert specimen.stretch_to(3.0) == pytest.approx(top_n)
    assert specimen.state.axial_strain == pytest.approx(strain_at_top)


def test_plastic_flow_keeps_the_volume():
    specimen = SimulatedSpecimen(SpecimenSettings())
    specimen.stretch_to(5.0)
    assert specimen.stretch_to(0.0) == 0.0
    assert specimen.state.axial_strain > 0.05
    assert (1 + specimen.state.axial_strain) * (1 + specimen.state.transverse_strain) ** 2 == pytest.approx(1)


def test_the_path_to_a_displacement_does_not_matter_while_it_only_grows():
    at_once, by_steps = SimulatedSpecimen(SpecimenSettings()), SimulatedSpecimen(SpecimenSettings())
    for displacement_mm in np.linspace(0, 4, 101):
        load_n = by_steps.stretch_to(displacement_mm)
    assert at_once.stretch_to(4.0) == pytest.approx(load_n, rel=1e-12)


def test_a_slack_sheet_carries_no_compression():
    assert SimulatedSpecimen(SpecimenSettings()).stretch_to(-1.0) == 0.0


def test_a_broken_specimen_stays_broken():
    specimen = SimulatedSpecimen(SpecimenSettings(fracture_strain=0.05))
    assert specimen.stretch_to(6.0) == 0.0
    assert specimen.state.broken
    assert specimen.stretch_to(1.0) == 0.0


def test_a_material_that_does_not_harden_is_refused():
    with pytest.raises(ValidationError, match="ultimate_stress_mpa must exceed yield_stress_mpa"):
        SpecimenSettings(ultimate_stress_mpa=300.0)


def test_a_material_too_soft_to_reach_its_strength_is_refused():
    # 483 MPa stretch 3 GPa by 16 % elastically, more than the 15 % at which it is to be reached
    with pytest.raises(ValidationError, match="ultimate_strain must exceed its elastic part"):
        SpecimenSettings(youngs_modulus_mpa=3000.0)
