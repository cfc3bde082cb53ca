"""A dog-bone specimen of 2024-T3 sheet between grips: load and strain at a given displacement."""

from dataclasses import dataclass
from math import exp, log

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from drivers.settings import Settings

# The yield stress is the stress at this plastic strain (0.2 % offset).
YIELD_STRAIN = 0.002
# Relative accuracy of a load, some hundred times the rounding error of a floating-point number.
_ROUNDING = 1e-13


class SpecimenSettings(Settings):
    """Dimensions, material and grips of the specimen.

    The defaults are typical of 2024-T3 (Aluminum Association, as in MatWeb's sheet "Aluminum 2024-T3"):
    modulus 73.1 GPa, Poisson's ratio 0.33, yield 345 MPa, ultimate strength 483 MPa, elongation 18 %. The
    default stiffness and grip slip are those of a typical mechanical load frame with wedge grips.
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
    grip_slip_mm: float = Field(default=0.6, ge=0, description="total slip of the specimen in the grips")
    grip_slip_load_n: float = Field(
        default=1500.0, gt=0, description="load at which 63 % of the slip has happened"
    )
    machine_stiffness_n_mm: float = Field(
        default=15_000.0, gt=0, description="stiffness of grips and load frame in series"
    )
    centre_travel: float = Field(
        default=0.0, ge=0, le=1, description="displacement of the middle / displacement of the crosshead"
    )

    @model_validator(mode="after")
    def _hardens(self) -> "SpecimenSettings":
        if self.ultimate_stress_mpa <= self.yield_stress_mpa:
            raise ValueError("ultimate_stress_mpa must exceed yield_stress_mpa")
        if self.plastic_at_ultimate <= YIELD_STRAIN:
            raise ValueError(
                "ultimate_strain must exceed its elastic part, ultimate_stress_mpa / youngs_modulus_mpa, "
                f"by more than {YIELD_STRAIN}"
            )
        return self

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

    The axial strain along Y and the transverse strain along X are engineering strains of the gauge section.
    """

    displacement_mm: float = 0.0
    load_n: float = 0.0
    axial_strain: float = 0.0
    transverse_strain: float = 0.0
    broken: bool = False

    def deformation_gradient(self) -> NDArray[np.float64]:
        """Return the deformation gradient F (2, 2) of the gauge section, in X and Y."""
        return np.diag([1.0 + self.transverse_strain, 1.0 + self.axial_strain])


class Specimen:
    """Specimen, grips and load frame in series. The highest load so far determines plastic strain and slip.

    The first loading follows the law of Ramberg and Osgood for the strain at the stress s, with Young's
    modulus E: ``strain = s/E + 0.002 (s/yield)^n``. The exponent n is such that the strain at the ultimate
    stress is the ultimate strain. Load frame and grips add their elastic compliance and the slip
    ``slip (1 - exp(-load / slip load))``. Unloading is elastic: plastic strain and slip do not change. The
    specimen carries no compression. Beyond the fracture strain, the specimen is broken.
    """

    def __init__(self, settings: SpecimenSettings) -> None:
        self.settings = settings
        self.state = SpecimenState()
        s = settings
        self._elastic_n = s.youngs_modulus_mpa * s.area_mm2
        self._elastic_mm_per_n = s.parallel_length_mm / self._elastic_n + 1.0 / s.machine_stiffness_n_mm
        self._exponent = log(s.plastic_at_ultimate / YIELD_STRAIN) / log(
            s.ultimate_stress_mpa / s.yield_stress_mpa
        )
        self._highest_n = 0.0

    def stretch_to(self, displacement_mm: float) -> float:
        """Move the crosshead to a displacement, counted from the test's start; return the load in N."""
        if self.state.broken:
            load_n = 0.0
        else:
            beyond_mm = displacement_mm - self._virgin_displacement_mm(self._highest_n)
            if beyond_mm > 0.0:
                self._highest_n = self._virgin_load_n(displacement_mm, beyond_mm)
                load_n = self._highest_n
            else:
                load_n = max(0.0, self._highest_n + beyond_mm / self._elastic_mm_per_n)
        broken = self.state.broken or self._total_strain(self._highest_n) > self.settings.fracture_strain
        self.state = self._state_at(displacement_mm, 0.0 if broken else load_n, broken)
        return self.state.load_n

    def break_now(self) -> None:
        """Break the specimen at its current strain."""
        self.state = self._state_at(self.state.displacement_mm, 0.0, True)

    def _state_at(self, displacement_mm: float, load_n: float, broken: bool) -> SpecimenState:
        elastic = load_n / self._elastic_n
        plastic = self._plastic_strain(self._highest_n)
        # Plastic flow does not change the volume, so both transverse stretches are (1 + plastic)^-1/2.
        transverse = -self.settings.poisson_ratio * elastic + (1.0 + plastic) ** -0.5 - 1.0
        return SpecimenState(displacement_mm, load_n, elastic + plastic, transverse, broken)

    def _plastic_strain(self, load_n: float) -> float:
        stress_mpa = load_n / self.settings.area_mm2
        return float(YIELD_STRAIN * (stress_mpa / self.settings.yield_stress_mpa) ** self._exponent)

    def _total_strain(self, load_n: float) -> float:
        return load_n / self._elastic_n + self._plastic_strain(load_n)

    def _virgin_displacement_mm(self, load_n: float) -> float:
        s = self.settings
        slip_mm = s.grip_slip_mm * (1.0 - exp(-load_n / s.grip_slip_load_n))
        return load_n * self._elastic_mm_per_n + slip_mm + self._plastic_strain(load_n) * s.parallel_length_mm

    def _virgin_compliance_mm_n(self, load_n: float) -> float:
        """Return the derivative of `_virgin_displacement_mm` at a load above 0."""
        s = self.settings
        slip_mm_n = s.grip_slip_mm / s.grip_slip_load_n * exp(-load_n / s.grip_slip_load_n)
        plastic_per_n = self._exponent * self._plastic_strain(load_n) / load_n
        return self._elastic_mm_per_n + slip_mm_n + plastic_per_n * s.parallel_length_mm

    def _virgin_load_n(self, displacement_mm: float, beyond_mm: float) -> float:
        """Return the load on the curve of first loading, by Newton's method between two bounds.

        The elastic compliance is the lowest possible compliance, so it gives the upper bound of the load.
        """
        low, high = self._highest_n, self._highest_n + beyond_mm / self._elastic_mm_per_n
        load_n = 0.5 * (low + high)
        while True:
            excess_mm = self._virgin_displacement_mm(load_n) - displacement_mm
            low, high = (load_n, high) if excess_mm < 0.0 else (low, load_n)
            next_n = load_n - excess_mm / self._virgin_compliance_mm_n(load_n)
            if abs(next_n - load_n) <= _ROUNDING * load_n or high - low <= _ROUNDING * high:
                return min(max(next_n, low), high)
            load_n = next_n if low < next_n < high else 0.5 * (low + high)
