"""Laws of hardening of the virtual specimen: the nominal stress at a plastic strain.

The plastic strain p is the engineering strain that remains after unloading. The true stress σ is a function
of the true plastic strain ln(1 + p), and the nominal stress, load over the original area, is σ / (1 + p).
"""

from math import exp, log
from typing import Annotated, Literal, Protocol

from pydantic import Field, model_validator

from drivers.settings import Settings
from simulators.scene.band import BandSettings

_HALVINGS = 200


class Law(Protocol):
    """A law of hardening."""

    def true_stress_mpa(self, true_plastic: float) -> float:
        """Return the true stress at a true plastic strain."""

    def true_slope_mpa(self, true_plastic: float) -> float:
        """Return the derivative of the true stress."""


class Swift(Settings):
    """Swift's law: true stress = strength · (offset + true plastic strain) ^ exponent."""

    law: Literal["swift"] = "swift"
    strength_mpa: float = Field(gt=0)
    offset_strain: float = Field(gt=0, le=0.1)
    exponent: float = Field(gt=0, le=1)

    def true_stress_mpa(self, true_plastic: float) -> float:
        """Return the true stress at a true plastic strain."""
        return float(self.strength_mpa * (self.offset_strain + true_plastic) ** self.exponent)

    def true_slope_mpa(self, true_plastic: float) -> float:
        """Return the derivative of the true stress."""
        return self.exponent * self.true_stress_mpa(true_plastic) / (self.offset_strain + true_plastic)


class Voce(Settings):
    """Voce's law: true stress = saturation - (saturation - initial) · exp(-true plastic strain / scale)."""

    law: Literal["voce"] = "voce"
    initial_mpa: float = Field(gt=0, description="stress at which plastic flow begins")
    saturation_mpa: float = Field(gt=0)
    strain_scale: float = Field(gt=0, le=1)

    @model_validator(mode="after")
    def _hardens(self) -> "Voce":
        if self.saturation_mpa <= self.initial_mpa:
            raise ValueError("saturation_mpa must exceed initial_mpa")
        return self

    def true_stress_mpa(self, true_plastic: float) -> float:
        """Return the true stress at a true plastic strain."""
        missing = exp(-true_plastic / self.strain_scale)
        return self.saturation_mpa - (self.saturation_mpa - self.initial_mpa) * missing

    def true_slope_mpa(self, true_plastic: float) -> float:
        """Return the derivative of the true stress."""
        return (self.saturation_mpa - self.true_stress_mpa(true_plastic)) / self.strain_scale


HardeningLaw = Annotated[Swift | Voce, Field(discriminator="law")]


class YieldPoint(Settings):
    """Upper yield point and plateau.

    The stress falls linearly from the upper to the lower yield strength, and keeps this value until the end
    of the plateau. Then the stress rises by as much as the stress of the hardening law. The plastic strains
    are those of the whole parallel length. Without `band` the strain is the same everywhere. With `band` a
    Lüders band travels along the sheet during the drop and the plateau.
    """

    upper_mpa: float = Field(gt=0)
    lower_mpa: float = Field(gt=0)
    drop_strain: float = Field(default=0.002, gt=0, description="plastic strain during the drop")
    plateau_strain: float = Field(default=0.015, gt=0, le=0.1, description="plastic strain at the end")
    band: BandSettings | None = Field(default=None, description="a Lüders band that travels along the sheet")

    @model_validator(mode="after")
    def _drops(self) -> "YieldPoint":
        if self.upper_mpa <= self.lower_mpa:
            raise ValueError("upper_mpa must exceed lower_mpa")
        if self.plateau_strain <= self.drop_strain:
            raise ValueError("plateau_strain must exceed drop_strain")
        return self


class FlowCurve:
    """Nominal stress at each plastic strain, for a law of hardening with or without a yield point."""

    def __init__(self, law: Law, yield_point: YieldPoint | None) -> None:
        self._law = law
        self._point = yield_point
        # The true plastic strain at which hardening begins.
        self._start = 0.0 if yield_point is None else log(1.0 + yield_point.plateau_strain)
        self.onset_mpa = self.stress_mpa(0.0)
        self.uniform = self._find_uniform()

    def stress_mpa(self, plastic: float) -> float:
        """Return the nominal stress at a plastic strain."""
        point = self._point
        if point is not None and plastic < point.plateau_strain:
            fallen = min(plastic / point.drop_strain, 1.0)
            return point.upper_mpa - fallen * (point.upper_mpa - point.lower_mpa)
        return self._hardened_mpa(plastic) / (1.0 + plastic)

    def slope_mpa(self, plastic: float) -> float:
        """Return the derivative of the nominal stress."""
        point = self._point
        if point is not None and plastic < point.plateau_strain:
            falls = plastic < point.drop_strain
            return -(point.upper_mpa - point.lower_mpa) / point.drop_strain if falls else 0.0
        slope = self._law.true_slope_mpa(log(1.0 + plastic) - self._start)
        return (slope - self._hardened_mpa(plastic)) / (1.0 + plastic) ** 2

    def highest_mpa(self, plastic: float) -> float:
        """Return the highest nominal stress up to a plastic strain."""
        return max(self.onset_mpa, self.stress_mpa(min(plastic, self.uniform)))

    def _hardened_mpa(self, plastic: float) -> float:
        """Return the true stress after the plateau."""
        rise = self._law.true_stress_mpa(log(1.0 + plastic) - self._start)
        if self._point is None:
            return rise
        lower = self._point.lower_mpa * (1.0 + self._point.plateau_strain)
        return lower + rise - self._law.true_stress_mpa(0.0)

    def _find_uniform(self) -> float:
        """Return the plastic strain of the largest nominal stress, at which necking begins (Considère)."""
        low = 0.0 if self._point is None else self._point.plateau_strain
        high = 10.0
        if self.slope_mpa(low) <= 0.0:
            return low
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if self.slope_mpa(middle) > 0.0 else (low, middle)
        return low
