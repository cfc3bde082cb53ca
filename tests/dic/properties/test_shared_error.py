"""An error that all strains of a record share does not become smaller by averaging."""

from dataclasses import replace

import numpy as np
import pytest

from dic import material_properties
from dic.properties import (
    Curve,
    JoinError,
    PropertySettings,
    with_delay_error,
    with_join_error,
    with_shared_error,
)
from tests.dic.properties.synthetic import strain_of_stress

E_MPA, AREA_MM2 = 200_000.0, 10.0


def record(points=400):
    """Return a record of steel by the law of Ramberg and Osgood, without noise."""
    stress = np.linspace(0.0, 420.0, points)
    strain = strain_of_stress(stress, E_MPA, 400.0, 25)
    return Curve("made", AREA_MM2 * stress, strain, -0.3 * strain)


def test_slope_gets_the_share_of_the_error_at_the_end_of_its_window():
    curve = record()
    found = material_properties(curve, PropertySettings(AREA_MM2))
    share = 0.02
    judged = with_shared_error(found, share * curve.strain)
    # Strain larger by a share p gives a slope that is smaller by the factor 1 / (1 + p).
    e_gpa = found.values["E_gpa"].value
    expected = 0.5 * e_gpa * (1 / (1 - share) - 1 / (1 + share))
    assert judged.strain_parts["E_gpa"] == pytest.approx(expected, rel=0.02)
    assert judged.values["E_gpa"].std == pytest.approx(
        np.hypot(expected, found.values["E_gpa"].std), rel=0.02
    )
    assert judged.values["E_gpa"].value == e_gpa
    # A share of strain does the same to both strains whose ratio is ν only if both have it: here one has.
    assert judged.strain_parts["nu"] == pytest.approx(share * 0.3, rel=0.03)
    # Load alone gives Rm.
    assert judged.strain_parts["Rm_mpa"] == 0.0
    assert "strain calibration" not in judged.as_dict()["not_counted"]
    assert judged.as_dict()["std_by_strain"]["E_gpa"] == judged.strain_parts["E_gpa"]


def test_a_shift_towards_the_camera_changes_poissons_ratio_by_both_strains():
    curve, share = record(), 0.005
    found = material_properties(curve, PropertySettings(AREA_MM2))
    error = share * curve.strain
    both = np.column_stack([error, np.zeros(400)])
    judged = with_shared_error(found, error, both)
    # d(-t / e) for the same error in t and e
    assert judged.strain_parts["nu"] == pytest.approx(share * (1 + 0.3), rel=0.03)
    assert judged.strain_parts["E_gpa"] == pytest.approx(
        with_shared_error(found, error).strain_parts["E_gpa"], rel=1e-9
    )
    apart = with_shared_error(found, error, np.column_stack([np.zeros(400), error]))
    assert apart.strain_parts["nu"] == pytest.approx(share * np.hypot(0.3, 1.0), rel=0.03)


@pytest.mark.extended
def test_an_error_that_follows_the_motion_changes_the_slope_by_its_own_growth():
    curve, share = record(), 0.01
    found = material_properties(curve, PropertySettings(AREA_MM2))
    none, strain = np.zeros(400), share * curve.strain

    def part(along, across, name="E_gpa"):
        followed = np.stack([along, across])[..., None].transpose(1, 0, 2)
        return with_shared_error(found, none, followed=followed).strain_parts[name]

    e_gpa = found.values["E_gpa"].value
    assert part(strain, none) == pytest.approx(share * e_gpa, rel=0.03)
    assert part(-strain, none) == pytest.approx(part(strain, none), rel=1e-9)
    # The same offset of all points changes no slope, although its size at the end of the window is the same.
    end = np.full(400, strain[found.elastic.line.stop - 1])
    assert part(end, none) < 1e-3 * part(strain, none)
    assert part(strain, strain, "nu") == pytest.approx(share * (1 + 0.3), rel=0.03)
    # Errors of one cause in both strains may compensate each other: both strains larger by the same share.
    assert part(strain, -0.3 * strain, "nu") < 1e-3
    # Independent causes add up as squares.
    both = np.stack([np.stack([strain, none], axis=1), np.stack([strain, none], axis=1)], axis=2)
    twice = with_shared_error(found, none, followed=both).strain_parts["E_gpa"]
    assert twice == pytest.approx(np.sqrt(2) * part(strain, none), rel=1e-9)


def test_error_that_is_declared_as_a_share_gives_the_same_deviation():
    curve, share = record(), 0.01
    declared = material_properties(curve, PropertySettings(AREA_MM2, strain_std_percent=100 * share))
    plain = material_properties(curve, PropertySettings(AREA_MM2))
    judged = with_shared_error(plain, share * curve.strain)
    for name in ("E_gpa", "Rp02_mpa"):
        assert judged.values[name].std == pytest.approx(declared.values[name].std, rel=0.1), name


def test_unknown_error_is_not_counted():
    found = material_properties(record(), PropertySettings(AREA_MM2))
    judged = with_shared_error(found, np.full(400, np.nan))
    assert judged is found
    assert "strain calibration" in judged.as_dict()["not_counted"]


def test_record_without_elastic_line_stays_as_it_is():
    settings = PropertySettings(AREA_MM2, window_mpa=(900.0, 950.0))
    found = material_properties(replace(record()), settings)
    assert with_shared_error(found, np.full(400, 1e-5)) is found


def test_a_record_with_a_loop_keeps_its_window_when_the_error_is_added():
    rise = np.linspace(0.0, 0.0018, 80), np.linspace(0.0018, 0.0003, 60), np.linspace(0.0003, 0.02, 600)
    strain = np.concatenate(rise)
    rng = np.random.default_rng(3)
    stress = np.minimum(70e3 * strain, 250 + 2000 * (strain - 250 / 70e3)) + rng.normal(0, 0.3, len(strain))
    found = material_properties(
        Curve("t", AREA_MM2 * stress, strain + rng.normal(0, 2e-5, len(strain))), PropertySettings(AREA_MM2)
    )
    share = 0.01
    judged = with_shared_error(found, share * np.abs(found.record.curve.strain))
    line = found.elastic.line
    same = material_properties(found.record.curve, found.settings, (line.first, line.stop))
    assert same.elastic.line.slope == pytest.approx(line.slope, rel=1e-12)
    # The error grows with the load to its size at the end of the window, and divides the slope by 1 ± share.
    error = share * found.record.curve.strain[line.stop - 1] / stress[line.stop - 1] * line.slope
    assert judged.strain_parts["E_gpa"] == pytest.approx(error * found.values["E_gpa"].value, rel=0.02)


def test_a_strength_that_an_error_of_strain_takes_away_keeps_its_error_from_the_other_side():
    whole = record(2000)
    keep = whole.strain <= 0.00405
    curve = Curve("made", whole.load_n[keep], whole.strain[keep])
    # Beyond the elastic window, strains that are smaller by 2 % end before the shifted elastic line. Without
    # this end, both sides are known, and the curve is the same up to the strength.
    sides = {}
    for end, record_of in (("near", curve), ("far", Curve("made", whole.load_n, whole.strain))):
        plain = material_properties(record_of, PropertySettings(AREA_MM2))
        error = np.zeros((len(record_of.strain), 2, 1))
        beyond = record_of.strain > 0.003
        error[beyond, 0, 0] = 0.02 * record_of.strain[beyond]
        sides[end] = with_shared_error(plain, np.zeros(len(error)), followed=error)
    near = sides["near"].values["Rp02_mpa"]
    assert near.value == pytest.approx(400.0, abs=0.01)
    assert "strain error" not in " ".join(near.flags)
    assert sides["near"].strain_parts["Rp02_mpa"] == pytest.approx(
        sides["far"].strain_parts["Rp02_mpa"], rel=0.25
    )
    assert near.std > 0.5


def test_a_strength_that_an_error_of_strain_takes_away_on_both_sides_has_no_deviation(monkeypatch):
    curve = record(400)
    found = material_properties(curve, PropertySettings(AREA_MM2))

    def lost(*given):
        side = material_properties(*given)
        none = replace(side.values["Rp02_mpa"], value=None, std=None)
        return replace(side, values={**side.values, "Rp02_mpa": none})

    monkeypatch.setattr("dic.properties.shared_error.material_properties", lost)
    judged = with_shared_error(found, 0.01 * curve.strain)
    strength = judged.values["Rp02_mpa"]
    assert (strength.value, strength.std) == (found.values["Rp02_mpa"].value, None)
    assert strength.flags[-1].startswith("strain error: the value does not exist")
    assert "Rp02_mpa" not in judged.strain_parts
    assert judged.values["E_gpa"].std > found.values["E_gpa"].std


def test_a_wrong_clock_changes_slope_and_strength_as_theory_says():
    """Stress s and strain e grow evenly with time up to yielding; then the stress grows at a lower speed."""
    time_s, yield_s, late_s, share = np.arange(400.0), 200.0, 2.0, 0.005
    strain = 1e-5 * np.minimum(time_s, yield_s) + 5e-5 * np.maximum(time_s - yield_s, 0.0)
    speeds = 2.0, 0.5  # MPa per second, elastic and plastic
    stress = speeds[0] * np.minimum(time_s, yield_s) + speeds[1] * np.maximum(time_s - yield_s, 0.0)
    rate = np.where(time_s <= yield_s, *speeds)
    curve = Curve("made", AREA_MM2 * stress, strain, -0.3 * strain)
    found = material_properties(curve, PropertySettings(AREA_MM2, window_mpa=(50.0, 350.0)))
    errors = AREA_MM2 * rate[:, None] * np.column_stack([np.full(400, late_s), share * time_s])
    judged = with_join_error(found, JoinError(errors, -0.5))
    modulus, strength = judged.join_parts["E_gpa"], judged.join_parts["Rp02_mpa"]
    assert modulus["offset"] == pytest.approx(0.0, abs=1e-6)
    # A machine's clock that is fast by a share makes all loads of the even rise larger by this share.
    assert modulus["clock_rate"] == pytest.approx(share * 200.0, rel=1e-6)
    # With the plastic strain p = e - s / E, the strength changes by s' d - s' (e'_el - s' / E) d / p', where
    # d is the delay, s' and p' are speeds beyond yielding and e'_el is the elastic speed of the strain.
    plastic = 5e-5 - speeds[1] / 200e3
    expected = speeds[1] * late_s * (1.0 - (1e-5 - speeds[1] / 200e3) / plastic)
    assert strength["offset"] == pytest.approx(expected, rel=0.02)
    both = modulus["offset"] ** 2 + modulus["clock_rate"] ** 2
    assert modulus["both"] == pytest.approx(np.sqrt(both), rel=1e-6)
    # Loads that are larger by a late offset and by a fast clock both make the strength larger.
    a, b = strength["offset"], strength["clock_rate"]
    assert strength["both"] ** 2 == pytest.approx(a * a + b * b - a * b, rel=1e-6)
    assert judged.values["Rp02_mpa"].std == pytest.approx(
        np.hypot(found.values["Rp02_mpa"].std, strength["both"])
    )
    # The ratio of two strains does not depend on the load's scale.
    assert judged.join_parts["nu"]["both"] == pytest.approx(0.0, abs=1e-9)
    assert judged.as_dict()["std_by_join"]["E_gpa"] == modulus
    assert " and 1 GPa, Rp02 " in judged.time_texts[0]


@pytest.mark.parametrize("rising", [False, True])
def test_an_image_of_the_break_leaves_the_error_of_the_strength_that_of_its_maximum(rising):
    """The load falls to zero in 40 ms, and an image in this time is late by a standard deviation of 20 ms.

    If the specimen necks before, a wrong time does not change the maximum. If it breaks while the load rises,
    the largest load that an image shows is wrong by the rate of the rise.
    """
    time_s, late_s = 0.1 * np.arange(400.0), 0.02
    strain = 5e-5 * np.arange(400.0)
    sharp = 200e3 * np.minimum(strain, 0.002)
    begun = np.maximum(strain - 0.002, 0.0) / 0.018
    stress = sharp + (50.0 * begun if rising else 200.0 * begun * (1.5 - begun))
    rate = np.gradient(stress, time_s)
    strength, of_strength = stress.max(), rate[stress.argmax()]
    fall = np.array([0.9, 0.0, 0.0])
    stress, strain = np.append(stress, strength * fall), np.append(strain, strain[-1] + [1e-4, 2e-4, 3e-4])
    rate = np.append(rate, [-strength / 0.04, 0.0, 0.0])
    curve = Curve("made", AREA_MM2 * stress, strain)
    found = material_properties(curve, PropertySettings(AREA_MM2))
    judged = with_delay_error(found, AREA_MM2 * rate * late_s)
    expected = of_strength * late_s if rising else 0.0
    assert judged.delay_parts["Rm_mpa"] == pytest.approx(expected, rel=1e-6, abs=1e-5 * strength)
    # In the elastic part every load is larger by the same amount, which does not change the slope.
    assert judged.delay_parts["E_gpa"] == pytest.approx(0.0, abs=1e-3)
