"""Material properties of records whose properties are known by construction."""

from dataclasses import replace

import numpy as np
import pytest

import dic
from tests.dic.properties.synthetic import PowerLaw, strain_of_stress, with_yield_point

AREA = dic.properties.PropertySettings(area_mm2=20.0)


def properties(strain, stress, settings=AREA, **others):
    """Evaluate a record of stresses in MPa."""
    return dic.material_properties(
        dic.properties.Curve("record", settings.area_mm2 * stress, strain, **others), settings
    )


@pytest.fixture(scope="module")
def steel():
    return properties(*with_yield_point())


def test_every_promised_value_is_there_with_all_its_parts(steel):
    names = ["E_gpa", "nu", "Rp02_mpa", "ReH_mpa", "ReL_mpa", "Ae_percent", "Rm_mpa", "Ag_percent"]
    names += ["Agt_percent", "A_percent", "r", "n"]
    content = steel.as_dict()
    assert set(names) <= set(content)
    for name in names:
        parts = content[name]
        assert set(parts) == {"value", "std", "low", "high", "unit", "rule", "window", "flags"}
        assert parts["rule"]
        if parts["value"] is None:
            assert parts["flags"][0].startswith("missing: ")
        else:
            assert parts["low"] <= parts["value"] <= parts["high"]


def test_a_yield_point_is_found_without_its_first_transient(steel):
    values = steel.values
    assert values["E_gpa"].value == pytest.approx(200.0, rel=1e-6)
    assert values["ReH_mpa"].value == pytest.approx(400.0, abs=0.1)
    assert values["ReL_mpa"].value == pytest.approx(380.0, abs=0.1)
    # from 0.2 % to 1.0 %, where the level of 380 MPa meets the line of hardening
    assert values["Ae_percent"].value == pytest.approx(0.8, abs=0.01)
    assert values["Rm_mpa"].value == pytest.approx(500.0)


def test_an_offset_strength_on_the_plateau_is_computed_and_flagged(steel):
    value = steel.values["Rp02_mpa"]
    # 200 GPa (e - 0.002) meets the side of the plateau between 0.3 % and 0.6 % at 0.393 %
    assert value.value == pytest.approx(np.interp(0.00393, [0.003, 0.006], [386.0, 384.0]), abs=0.05)
    assert any(flag.startswith("plateau:") for flag in value.flags)


def test_what_the_extensometer_did_not_see_is_missing_with_the_reason(steel):
    for name in ("Ag_percent", "Agt_percent", "A_percent", "n"):
        assert steel.values[name].value is None
        assert "extensometer" in steel.values[name].flags[0]


def _jumping(strain, off):
    strain[off:] -= 0.02
    return strain


@pytest.mark.parametrize(
    "after",
    [
        lambda strain, off: np.concatenate([strain[:off], np.full(len(strain) - off, strain[off])]),
        lambda strain, off: np.where(
            np.arange(len(strain)) < off, strain, 0.029 + 3e-6 * np.sin(np.arange(len(strain)))
        ),
        _jumping,
    ],
    ids=["it stands still", "it stands still but for noise", "it jumps back"],
)
def test_strain_after_the_extensometer_was_taken_off_is_not_used(after):
    strain, stress = with_yield_point()
    off = int(np.argmax(np.isnan(strain)))
    whole = np.where(np.isnan(strain), 0.03 + 1e-4 * (np.arange(len(strain)) - off), strain)
    found = properties(after(whole, off), stress)
    assert found.flags[0].startswith("extensometer:")
    assert abs(found.record.end - off) <= 2
    assert found.values["Agt_percent"].value is None
    assert found.values["Rm_mpa"].value == pytest.approx(500.0)


@pytest.mark.parametrize("foot", [0.0, 7e-4, -4e-4])
@pytest.mark.parametrize("exponent", [8, 15, 30])
def test_offset_strengths_of_ramberg_osgood_are_the_law_s(exponent, foot):
    stress = np.concatenate([np.linspace(0, 400, 900), np.linspace(400.1, 460, 100)])
    strain = strain_of_stress(stress, 70e3, 300.0, exponent) + foot
    settings = replace(AREA, offsets_percent=(0.2, 0.1), window_mpa=(5, 90))
    values = properties(strain, stress, settings).values
    assert values["Rp02_mpa"].value == pytest.approx(300.0, rel=2e-4)
    # where 0.002 (stress / 300 MPa)^N is 0.001
    assert values["Rp01_mpa"].value == pytest.approx(300.0 * 0.5 ** (1 / exponent), rel=2e-4)
    assert values["ReH_mpa"].value is None


@pytest.fixture(scope="module")
def bar():
    law = PowerLaw()
    along, across, stress = law.record()
    broken = np.concatenate([stress, [0.5 * stress[-1], 0.0]])
    kept = [np.concatenate([strain, strain[-1:], strain[-1:]]) for strain in (along, across)]
    return (
        law,
        properties(kept[0], broken, replace(AREA, window_mpa=(3, 20)), transverse=kept[1]),
        (along, stress),
    )


def test_the_ratios_of_strain_are_found(bar):
    law, found, _ = bar
    assert found.values["nu"].value == pytest.approx(law.nu, rel=0.01)
    assert found.values["r"].value == pytest.approx(law.r, rel=0.01)


def test_the_exponent_and_the_onset_of_necking_are_those_of_considere(bar):
    law, found, _ = bar
    assert found.values["n"].value == pytest.approx(law.n, rel=0.01)
    assert found.laws["swift"]["parameters"]["n"]["value"] == pytest.approx(law.n, rel=0.02)
    assert found.laws["swift"]["parameters"]["K_mpa"]["value"] == pytest.approx(law.k_mpa, rel=0.01)
    # the load is largest where the rate of hardening is the stress: at a plastic strain of n, nearly
    total = law.n + law.k_mpa * law.n**law.n / law.e_mpa
    assert found.necking.value == pytest.approx(total, rel=0.02)
    assert found.values["Agt_percent"].value == pytest.approx(100 * np.expm1(total), rel=0.02)
    largest = law.k_mpa * law.n**law.n * np.exp(-law.n)
    assert found.values["Rm_mpa"].value == pytest.approx(largest, rel=0.01)
    elastic = found.values["Agt_percent"].value - found.values["Ag_percent"].value
    assert elastic == pytest.approx(100 * largest / found.elastic.line.slope, rel=0.01)


def test_the_elongation_at_the_break_leaves_out_the_elastic_strain(bar):
    _, found, (along, stress) = bar
    expected = 100 * (along[-1] - found.elastic.foot - stress[-1] / found.elastic.line.slope)
    assert found.values["A_percent"].value == pytest.approx(expected, rel=1e-3)


@pytest.mark.extended
def test_voce_and_ramberg_osgood_find_their_own_laws():
    plastic = np.linspace(0, 0.15, 4000)
    true = 200 + 150 * -np.expm1(-18 * plastic)
    total = plastic + true / 100e3
    rise = np.linspace(0, 199.9, 400)
    strain = np.concatenate([np.expm1(rise / 100e3), np.expm1(total)])
    stress = np.concatenate([rise, true]) / (1 + strain)
    voce = properties(strain, stress).laws["voce"]["parameters"]
    for name, value in {"A_mpa": 200.0, "Q_mpa": 150.0, "b": 18.0}.items():
        assert voce[name]["value"] == pytest.approx(value, rel=0.01)
    true = np.concatenate([np.linspace(0, 250, 500), np.linspace(250.5, 380, 500)])
    total = strain_of_stress(true, 70e3, 300.0, 14)
    law = properties(np.expm1(total), true * np.exp(-total)).laws["ramberg_osgood"]
    assert law["parameters"]["N"]["value"] == pytest.approx(14, rel=0.01)
    assert law["parameters"]["S_mpa"]["value"] == pytest.approx(300, rel=0.01)


def test_declared_uncertainties_are_parts_of_the_standard_deviations():
    strain, stress = with_yield_point()
    declared = replace(AREA, area_std_mm2=0.1, load_std_percent=0.5, strain_std_percent=1.0)
    values = properties(strain, stress, declared).values
    # 0.1 of 20 mm² is 0.5 % too
    assert values["Rm_mpa"].std == pytest.approx(500.0 * np.hypot(0.005, 0.005), rel=0.01)
    assert values["E_gpa"].std == pytest.approx(200.0 * np.sqrt(0.005**2 + 0.005**2 + 0.01**2), rel=0.01)
    assert declared.not_counted == []
    assert AREA.not_counted == ["area", "load cell", "strain calibration"]


def test_a_fixed_window_is_used_and_described():
    strain, stress = with_yield_point()
    value = properties(strain, stress, replace(AREA, window_mpa=(50, 150))).values["E_gpa"]
    assert value.value == pytest.approx(200.0, rel=1e-9)
    low, high = value.window["stress_mpa"]
    assert 50 <= low < 53
    assert 147 < high <= 150
    assert properties(strain, stress, replace(AREA, window_mpa=(50, 51))).values["E_gpa"].value is None


def test_a_ladder_of_settled_steps_is_told_from_a_continuous_test():
    steps = np.repeat(np.arange(0.0, 400.0, 20.0), 12)
    noise = np.random.default_rng(1).normal(0, 0.05, len(steps))
    value = properties(steps / 200e3 + noise * 1e-6, steps + noise).values["E_gpa"]
    assert any(flag.startswith("ladder:") for flag in value.flags)
    assert not any(
        flag.startswith("ladder:") for flag in properties(*with_yield_point()).values["E_gpa"].flags
    )


def test_unloading_within_the_elastic_part_is_told():
    way = np.concatenate([np.linspace(0, 150, 150), np.linspace(149, 40, 60), np.linspace(41, 390, 350)])
    rest = np.linspace(391, 420, 200)
    stress = np.concatenate([way, rest])
    strain = np.concatenate([way / 200e3, 390 / 200e3 + np.linspace(1e-4, 0.03, 200)])
    found = properties(strain, stress)
    assert found.record.loops(len(way)) == [(pytest.approx(150.0), pytest.approx(40.0))]


def test_a_record_of_few_points_says_so():
    stress = np.linspace(0, 300, 14)
    value = properties(strain_of_stress(stress, 70e3, 280.0, 20), stress).values["E_gpa"]
    assert any(flag.startswith(("few points:", "missing: few points")) for flag in value.flags)


def test_necking_alone_is_no_yield_point():
    law = PowerLaw(n=0.006, k_mpa=420.0)
    along, _, stress = law.record()
    values = properties(along, stress, replace(AREA, window_mpa=(10, 150))).values
    assert values["ReH_mpa"].value is None
    assert values["Rm_mpa"].value == pytest.approx(stress.max())
