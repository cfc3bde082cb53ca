"""The plausible stiffness of specimen, grips and load frame in series, from protocol and rig file.

If a load cell shows only a fraction of the load, the measured stiffness is this fraction of the true
stiffness. This error is noticed only if the measured stiffness is below the lower bound of the stiffness. So
narrow bounds protect the specimen better than wide bounds.
"""

from dataclasses import dataclass

from rig.limit_settings import RigLimits
from rig.protocol.phased import PhasesProtocol
from rig.protocol.tension import TensionProtocol

POLYMER_MPA, COMPOSITE_MPA, STEEL_MPA = 1_000.0, 20_000.0, 250_000.0
"""Three Young's moduli. The first is that of the softest engineering thermoplastics. The second is that of
laminates with glass fibres, the softest materials that carry more than `POLYMER_STRENGTH_MPA`. The third is
that of steel, with a margin."""
POLYMER_STRENGTH_MPA = 120.0
"""Tensile strength that no thermoplastic without fibres exceeds (PEEK: 100 MPa, polyetherimide: 105 MPa)."""
MACHINE_MIN_N_MM = 5_000.0
"""Stiffness of a soft table-top load frame with wedge grips. Larger load frames have 20 to 300 kN/mm."""
SEATING_MM, SEATING_N_MM = 1.0, 2_500.0
"""While wedge grips seat under a rising load, they move by less than 1 mm and by at most 0.4 mm per kN."""
SLACK_SHARE = 0.3
"""At the displacement of the default slack, the stiffest system would carry this part of an increment."""
YIELD_STRAIN_MIN = 0.002
"""Up to this strain, a structural material carries at least the load that its softest modulus predicts."""
RELAXATION, RELAXATION_POLYMER = 0.01, 0.05
"""Fall of the load at constant displacement per decade of time, as a fraction, of metals and of polymers."""


@dataclass(frozen=True)
class LoadStringBounds:
    """Bounds of the behaviour of specimen, grips and load frame in series, during the first loading."""

    # bounds of the elastic stiffness
    stiffness_min_n_mm: float
    stiffness_max_n_mm: float
    # largest displacement by which the grips seat, and smallest rise of the load per mm while they seat
    seating_mm: float
    seating_n_mm: float
    slack_mm: float  # largest displacement before the load begins to rise
    flow_mm: float  # largest displacement at constant load after the load has risen
    relaxation: float  # largest fall of the load at rest per decade of time, as a fraction of the load
    # largest speed of the crosshead in an increment of load, or None if the protocol commands no load
    speed_max_mm_s: float | None
    elastic_mm: float  # displacement that stretches no specimen beyond its yield strain
    first_n: float  # an increment of load. On the first loading the specimen is elastic up to this load.

    def displacement_max_mm(self, load_n: float) -> float:
        """Return the largest plausible displacement at a load of the first loading."""
        elastic_mm = load_n / self.stiffness_min_n_mm
        return self.slack_mm + elastic_mm + min(self.seating_mm, load_n / self.seating_n_mm)

    @property
    def noticed_fraction(self) -> float:
        """A load cell that shows less than this fraction of the real load is noticed in every case.

        This is true for every specimen within the bounds, even if the grips do not seat.
        """
        softest_mm_n = 1.0 / self.stiffness_min_n_mm + 1.0 / self.seating_n_mm
        return 1.0 / (self.stiffness_max_n_mm * softest_mm_n)


def load_string(protocol: TensionProtocol | PhasesProtocol, rig: RigLimits) -> LoadStringBounds:
    """Return the bounds that protocol and rig file give, with default values for the other bounds.

    The protocol must move a load frame.
    """
    pull = protocol.conditions.pull
    assert pull is not None
    declared, sample = protocol.plausible, protocol.sample
    area_mm2 = sample.thickness_mm * sample.width_mm
    length_mm = declared.grip_length_mm or sample.gauge_length_mm
    is_polymer = pull.assured_n / area_mm2 <= POLYMER_STRENGTH_MPA
    modulus_min = declared.modulus_min_mpa or (POLYMER_MPA if is_polymer else COMPOSITE_MPA)
    modulus_max = declared.modulus_max_mpa or max(STEEL_MPA, 1.5 * modulus_min)
    machine_min = _first(declared.machine_stiffness_min_n_mm, rig.machine_stiffness_min_n_mm)
    machine_max = _first(declared.machine_stiffness_max_n_mm, rig.machine_stiffness_max_n_mm)
    softest_n_mm = _in_series(modulus_min * area_mm2 / length_mm, machine_min or MACHINE_MIN_N_MM)
    stiffest_n_mm = modulus_max * area_mm2 / length_mm
    if machine_max is not None:
        stiffest_n_mm = _in_series(stiffest_n_mm, machine_max)
    seating_n_mm = _first(declared.seating_stiffness_n_mm, rig.seating_stiffness_n_mm) or SEATING_N_MM
    seating_mm = _first(declared.seating_mm, rig.seating_mm)
    relaxation = RELAXATION_POLYMER if modulus_min < COMPOSITE_MPA else RELAXATION
    slack_mm = SLACK_SHARE * pull.increment_n / stiffest_n_mm
    slowest_n_mm = _in_series(softest_n_mm, seating_n_mm)
    speed_mm_s = None if pull.rate_n_s is None else pull.rate_n_s / slowest_n_mm
    return LoadStringBounds(
        stiffness_min_n_mm=softest_n_mm,
        stiffness_max_n_mm=stiffest_n_mm,
        seating_mm=SEATING_MM if seating_mm is None else seating_mm,
        seating_n_mm=seating_n_mm,
        slack_mm=slack_mm if declared.slack_mm is None else declared.slack_mm,
        flow_mm=declared.flow_mm,
        relaxation=relaxation if declared.relaxation is None else declared.relaxation,
        speed_max_mm_s=declared.speed_max_mm_s or speed_mm_s,
        elastic_mm=YIELD_STRAIN_MIN * length_mm,
        first_n=pull.increment_n,
    )


def _in_series(first_n_mm: float, second_n_mm: float) -> float:
    return 1.0 / (1.0 / first_n_mm + 1.0 / second_n_mm)


def _first(*values: float | None) -> float | None:
    return next((value for value in values if value is not None), None)
