"""A dog-bone specimen of 2024-T3 sheet between grips: load and strain for a given displacement."""

from dataclasses import dataclass
from math import exp

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from drivers.settings import Settings
from simulators.scene.band import Band, front_at
from simulators.scene.first_loading import YIELD_STRAIN, ByFlowCurve, FirstLoading, RambergOsgood
from simulators.scene.hardening import FlowCurve, HardeningLaw, YieldPoint

# Relative accuracy of a load, some hundred times the rounding error of a floating-point number.
_ROUNDING = 1e-13
BUCKLED_MM = 0.5
"""After a specimen has buckled, its load falls to 37 % over this travel of the crosshead."""


class SpecimenSettings(Settings):
    """Dimensions, material and grips of the specimen.

    The defaults are typical of 2024-T3 (Aluminum Association, as in MatWeb's sheet "Aluminum 2024-T3"):
    modulus 73.1 GPa, Poisson's ratio 0.33, yield 345 MPa, ultimate strength 483 MPa, elongation 18 %. The
    default stiffness and grip slip are those of a typical mechanical load frame with wedge grips.

    Without `hardening`, the material follows the law of Ramberg and Osgood through yield and ultimate stress.
    With `hardening`, the material is linear elastic up to the beginning of plastic flow and then follows this
    law; `yield_point` puts an upper yield point and a plateau before the law.
    """

    width_mm: float = Field(default=25.0, gt=0, description="width of the gauge section")
    thickness_mm: float = Field(default=1.0, gt=0, description="thickness of the sheet")
    parallel_length_mm: float = Field(default=60.0, gt=0, description="length that stretches uniformly")
    youngs_modulus_mpa: float = Field(default=73_100.0, gt=0)
    poisson_ratio: float = Field(default=0.33, ge=0, lt=0.5)
    yield_stress_mpa: float = Field(default=345.0, gt=0, description="stress at 0.2 % plastic strain")
    ultimate_stress_mpa: float = Field(default=483.0, gt=0)
    ultimate_strain: float = Field(default=0.15, gt=0.01, description="strain at the ultimate stress")
    fracture_strain: float = Field(default=0.18, gt=0.01)
    hardening: HardeningLaw | None = None
    yield_point: YieldPoint | None = None
    strain_ratio: float = Field(
        default=1.0, gt=0, le=10, description="r: true plastic strain of the width / of the thickness"
    )
    resting_depth: float = Field(
        default=0.0,
        ge=0,
        le=1,
        description="depth of the plane that keeps its place while the sheet becomes thinner, as a share of "
        "the thickness: 0 is the surface that the cameras see, 0.5 the middle of the sheet",
    )
    grip_slip_mm: float = Field(default=0.6, ge=0, description="total slip of the specimen in the grips")
    grip_slip_load_n: float = Field(
        default=1500.0, gt=0, description="load at which 63 % of the slip has happened"
    )
    machine_stiffness_n_mm: float = Field(
        default=15_000.0, gt=0, description="stiffness of grips and load frame in series"
    )
    buckling_load_n: float = Field(
        default=0.0, ge=0, description="compressive load at which the specimen buckles; 0 for a thin sheet"
    )
    centre_travel: float = Field(
        default=0.0, ge=0, le=1, description="displacement of the middle / displacement of the crosshead"
    )

    @model_validator(mode="after")
    def _hardens(self) -> "SpecimenSettings":
        if self.hardening is not None:
            return self._follows_its_law()
        if self.yield_point is not None:
            raise ValueError('yield_point needs a law in hardening, such as law = "swift"')
        if self.ultimate_stress_mpa <= self.yield_stress_mpa:
            raise ValueError("ultimate_stress_mpa must exceed yield_stress_mpa")
        if self.plastic_at_ultimate <= YIELD_STRAIN:
            raise ValueError(
                "ultimate_strain must exceed its elastic part, ultimate_stress_mpa / youngs_modulus_mpa, "
                f"by more than {YIELD_STRAIN}"
            )
        return self

    def _follows_its_law(self) -> "SpecimenSettings":
        idle = {"yield_stress_mpa", "ultimate_stress_mpa", "ultimate_strain"} & self.model_fields_set
        if idle:
            raise ValueError(f"{min(idle)} has no effect beside hardening; leave it out")
        flow = self.flow_curve()
        if self.yield_point is not None and self.yield_point.plateau_strain >= flow.uniform:
            raise ValueError("the law of hardening does not rise behind the plateau; give one that hardens")
        # If the stress drops steeply, a soft load frame springs back faster than the specimen lengthens. The
        # displacement would then have to decrease.
        steepest = min(flow.slope_mpa(0.0), flow.slope_mpa(self.fracture_strain))
        if self.parallel_length_mm + self.elastic_mm_per_n * self.area_mm2 * steepest <= 0.0:
            raise ValueError(
                f"the stress falls by up to {-steepest:.0f} MPa per unit of plastic strain, faster than the "
                "load frame can follow; raise drop_strain or machine_stiffness_n_mm"
            )
        return self

    def flow_curve(self) -> FlowCurve:
        """Return the flow curve of the law in `hardening`.

        Raises
        ------
        ValueError
            If the specimen follows the law of Ramberg and Osgood, which has no beginning of plastic flow.
        """
        if self.hardening is None:
            raise ValueError("without hardening there is no flow curve")
        return FlowCurve(self.hardening, self.yield_point)

    def first_loading(self) -> FirstLoading:
        """Return the curve of nominal stress and plastic strain of the first loading."""
        if self.hardening is not None:
            return ByFlowCurve(self.flow_curve(), self.youngs_modulus_mpa)
        return RambergOsgood(self.yield_stress_mpa, self.ultimate_stress_mpa, self.plastic_at_ultimate)

    @property
    def elastic_mm_per_n(self) -> float:
        """Elastic compliance of specimen, grips and load frame in series."""
        return (
            self.parallel_length_mm / (self.youngs_modulus_mpa * self.area_mm2)
            + 1.0 / self.machine_stiffness_n_mm
        )

    @property
    def plastic_at_ultimate(self) -> float:
        """Plastic strain at the ultimate stress."""
        return self.ultimate_strain - self.ultimate_stress_mpa / self.youngs_modulus_mpa

    @property
    def area_mm2(self) -> float:
        """Area of the gauge section's cross section, in mm²."""
        return self.width_mm * self.thickness_mm


@dataclass(frozen=True)
class SpecimenState:
    """State of the specimen at one time of a test.

    The axial strain along Y, the transverse strain along X and the strain of the thickness are engineering
    strains of the gauge section. While a Lüders band travels along it, they belong to the mean plastic strain
    of the parallel length, and `band` tells the strain at each place.
    """

    displacement_mm: float = 0.0
    load_n: float = 0.0
    axial_strain: float = 0.0
    transverse_strain: float = 0.0
    broken: bool = False
    thickness_strain: float = 0.0
    band: Band | None = None

    def deformation_gradient(self) -> NDArray[np.float64]:
        """Return the deformation gradient F (2, 2) of the gauge section, in X and Y."""
        return np.diag([1.0 + self.transverse_strain, 1.0 + self.axial_strain])


class SimulatedSpecimen:
    """Specimen, grips and load frame in series. The furthest point of the loading so far determines plastic
    strain and slip.

    The strain is ``stress / E + plastic strain``, with Young's modulus E and the stress over the original
    area. The law of the first loading gives stress and plastic strain (`simulators.scene.first_loading`).
    Load frame and grips add their elastic compliance and the slip ``slip (1 - exp(-load / slip load))`` of
    the highest load. Unloading is elastic: plastic strain and slip do not change. In compression the specimen
    is elastic up to its buckling load. Beyond, its load falls exponentially with the travel, and the way back
    is the same. Beyond the fracture strain, the specimen is broken. The strain is uniform, except for a
    Lüders band (`simulators.scene.band`) if `yield_point.band` is given. There is no neck after the largest
    load.

    Elastic strain narrows the sheet by Poisson's ratio. Plastic flow does not change the volume. With the
    strain ratio r and the plastic strain p, the plastic stretch of the width is (1 + p)^(-r / (1 + r)), and
    that of the thickness is (1 + p)^(-1 / (1 + r)).
    """

    def __init__(self, settings: SpecimenSettings) -> None:
        self.settings = settings
        self.state = SpecimenState()
        self._virgin = settings.first_loading()
        self._elastic_n = settings.youngs_modulus_mpa * settings.area_mm2
        self._elastic_mm_per_n = settings.elastic_mm_per_n
        self._furthest_mpa = 0.0

    def stretch_to(self, displacement_mm: float) -> float:
        """Move the crosshead to a displacement, counted from the test's start; return the load in N."""
        if self.state.broken:
            load_n = 0.0
        else:
            beyond_mm = displacement_mm - self._virgin_displacement_mm(self._furthest_mpa)
            if beyond_mm > 0.0:
                self._furthest_mpa = self._virgin_path_mpa(displacement_mm, beyond_mm)
                load_n = self._virgin_load_n(self._furthest_mpa)
            else:
                furthest_n = self._virgin_load_n(self._furthest_mpa)
                load_n = self._held_n(furthest_n + beyond_mm / self._elastic_mm_per_n)
        broken = self.state.broken or self._beyond_fracture()
        self.state = self._state_at(displacement_mm, 0.0 if broken else load_n, broken)
        return self.state.load_n

    def break_now(self) -> None:
        """Break the specimen at its current strain."""
        self.state = self._state_at(self.state.displacement_mm, 0.0, True)

    def front_mm(self) -> float:
        """Return the place Y of the front of the Lüders band: before and after its way, the end of this way.

        Raise `ValueError` if the specimen has no such band.
        """
        s, point = self.settings, self.settings.yield_point
        if point is None or point.band is None:
            raise ValueError("a specimen without a yield_point.band has no front")
        plastic = min(self._virgin.at(self._furthest_mpa).plastic, point.plateau_strain)
        return front_at(plastic, point.plateau_strain, point.band, s.parallel_length_mm)

    def _held_n(self, elastic_n: float) -> float:
        """Return the load that the specimen carries where an elastic specimen would carry `elastic_n`."""
        buckling_n = self.settings.buckling_load_n
        if elastic_n >= -buckling_n or buckling_n == 0.0:
            return max(elastic_n, -buckling_n)
        travel_mm = -(elastic_n + buckling_n) * self._elastic_mm_per_n
        return -buckling_n * exp(-travel_mm / BUCKLED_MM)

    def _beyond_fracture(self) -> bool:
        point = self._virgin.at(self._furthest_mpa)
        strain = point.stress_mpa / self.settings.youngs_modulus_mpa + point.plastic
        return strain > self.settings.fracture_strain

    def _state_at(self, displacement_mm: float, load_n: float, broken: bool) -> SpecimenState:
        elastic = load_n / self._elastic_n
        plastic = self._virgin.at(self._furthest_mpa).plastic
        r = self.settings.strain_ratio
        narrowed = -self.settings.poisson_ratio * elastic - 1.0
        across = narrowed + (1.0 + plastic) ** (-r / (1.0 + r))
        through = narrowed + (1.0 + plastic) ** (-1.0 / (1.0 + r))
        band = self._band(plastic, elastic)
        return SpecimenState(displacement_mm, load_n, elastic + plastic, across, broken, through, band)

    def _band(self, plastic: float, elastic: float) -> Band | None:
        """Return the Lüders band at a mean plastic strain, or None while there is none."""
        s, point = self.settings, self.settings.yield_point
        if point is None or point.band is None or not 0.0 < plastic < point.plateau_strain:
            return None
        return Band(
            front_mm=front_at(plastic, point.plateau_strain, point.band, s.parallel_length_mm),
            front_width_mm=point.band.front_width_mm,
            upward=point.band.start == "lower",
            strain=point.plateau_strain,
            elastic=elastic,
            elastic_across=-s.poisson_ratio * elastic,
            narrowing=s.strain_ratio / (1.0 + s.strain_ratio),
            length_mm=s.parallel_length_mm,
        )

    def _virgin_load_n(self, path_mpa: float) -> float:
        return self._virgin.at(path_mpa).stress_mpa * self.settings.area_mm2

    def _virgin_displacement_mm(self, path_mpa: float) -> float:
        return self._virgin_displacement_and_slope(path_mpa)[0]

    def _virgin_displacement_and_slope(self, path_mpa: float) -> tuple[float, float]:
        """Return the displacement of the first loading, mm, and its derivative along the path, mm/MPa."""
        s, point = self.settings, self._virgin.at(path_mpa)
        load_n, rise_n = point.stress_mpa * s.area_mm2, point.stress_slope * s.area_mm2
        left = exp(-point.highest_mpa * s.area_mm2 / s.grip_slip_load_n)
        slips = rise_n > 0.0 and point.stress_mpa >= point.highest_mpa
        slip_mm_n = left * s.grip_slip_mm / s.grip_slip_load_n if slips else 0.0
        plastic_mm = point.plastic * s.parallel_length_mm
        return (
            load_n * self._elastic_mm_per_n + s.grip_slip_mm * (1.0 - left) + plastic_mm,
            rise_n * (self._elastic_mm_per_n + slip_mm_n) + point.plastic_slope * s.parallel_length_mm,
        )

    def _virgin_path_mpa(self, displacement_mm: float, beyond_mm: float) -> float:
        """Return the path on the curve of first loading, by Newton's method between two bounds."""
        low = self._furthest_mpa
        # No compliance is lower than the elastic one, so this upper bound is high enough while the stress
        # rises.
        reach = beyond_mm / self._elastic_mm_per_n / self.settings.area_mm2
        while self._virgin_displacement_mm(low + reach) < displacement_mm:
            reach *= 2.0
        high = low + reach
        path = 0.5 * (low + high)
        while True:
            reached_mm, slope = self._virgin_displacement_and_slope(path)
            excess_mm = reached_mm - displacement_mm
            low, high = (path, high) if excess_mm < 0.0 else (low, path)
            nearer = path - excess_mm / slope
            if abs(nearer - path) <= _ROUNDING * path or high - low <= _ROUNDING * high:
                return min(max(nearer, low), high)
            path = nearer if low < nearer < high else 0.5 * (low + high)
