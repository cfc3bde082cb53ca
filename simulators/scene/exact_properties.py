"""The exact material properties of a virtual specimen, computed from its material laws alone."""

from typing import Any

from scipy.optimize import brentq

from simulators.scene.first_loading import YIELD_STRAIN
from simulators.scene.specimen import SpecimenSettings


def exact_properties(settings: SpecimenSettings) -> dict[str, Any]:
    """Return the properties that a perfect test of the specimen gives.

    The keys are E_gpa, nu, Rp02_mpa, ReH_mpa, ReL_mpa, Ae_percent, Rm_mpa, Ag_percent, Agt_percent, A_percent
    and r, and `law` describes the hardening. A value is None if the specimen has no such property: a sheet
    with a plateau has no Rp0.2, and a sheet without a plateau has no ReH.

    The strain is stress / E + plastic strain. So Rp0.2 is the stress at the plastic strain 0.002, A is the
    plastic strain at the break, and Ae lies between ReH and the end of the plateau.
    """
    modulus_mpa = settings.youngs_modulus_mpa
    found = _ramberg_osgood(settings) if settings.hardening is None else _flow_curve(settings)
    plain = {"E_gpa": modulus_mpa / 1e3, "nu": settings.poisson_ratio, "r": settings.strain_ratio}
    return plain | found


def _ramberg_osgood(settings: SpecimenSettings) -> dict[str, Any]:
    """Return the properties of a specimen whose stress rises until it breaks."""
    loading, modulus_mpa = settings.first_loading(), settings.youngs_modulus_mpa

    def beyond(stress_mpa: float) -> float:
        return stress_mpa / modulus_mpa + loading.at(stress_mpa).plastic - settings.fracture_strain

    strongest_mpa = float(brentq(beyond, 0.0, 10.0 * settings.ultimate_stress_mpa, xtol=1e-10))
    percent = 100.0 * loading.at(strongest_mpa).plastic
    return {
        "Rp02_mpa": settings.yield_stress_mpa,
        "ReH_mpa": None,
        "ReL_mpa": None,
        "Ae_percent": None,
        "Rm_mpa": strongest_mpa,
        "Ag_percent": percent,
        "Agt_percent": 100.0 * settings.fracture_strain,
        "A_percent": percent,
        "law": {"law": "ramberg-osgood", "yield_stress_mpa": settings.yield_stress_mpa}
        | {"ultimate_stress_mpa": settings.ultimate_stress_mpa, "ultimate_strain": settings.ultimate_strain},
    }


def _flow_curve(settings: SpecimenSettings) -> dict[str, Any]:
    """Return the properties of a specimen with a law of hardening."""
    flow, modulus_mpa, point = settings.flow_curve(), settings.youngs_modulus_mpa, settings.yield_point

    def beyond(plastic: float) -> float:
        return plastic + flow.stress_mpa(plastic) / modulus_mpa - settings.fracture_strain

    last = float(brentq(beyond, 0.0, settings.fracture_strain, xtol=1e-15))
    uniform = min(flow.uniform, last)
    strongest_mpa = flow.stress_mpa(uniform)
    plateau: dict[str, float | None] = {"ReH_mpa": None, "ReL_mpa": None, "Ae_percent": None}
    if point is not None:
        springs_back = (point.upper_mpa - point.lower_mpa) / modulus_mpa
        plateau = {"ReH_mpa": point.upper_mpa, "ReL_mpa": point.lower_mpa}
        plateau |= {"Ae_percent": 100.0 * (point.plateau_strain - springs_back)}
    law = {} if settings.hardening is None else settings.hardening.model_dump()
    return {
        "Rp02_mpa": flow.stress_mpa(YIELD_STRAIN) if point is None else None,
        **plateau,
        "Rm_mpa": strongest_mpa,
        "Ag_percent": 100.0 * uniform,
        "Agt_percent": 100.0 * (uniform + strongest_mpa / modulus_mpa),
        "A_percent": 100.0 * last,
        "law": law if point is None else law | {"yield_point": point.model_dump()},
    }
