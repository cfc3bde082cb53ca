"""The deformation that a study assumes: a wave of strain along each axis."""

from dataclasses import dataclass

import numpy as np

from dic.errors import CorrelationError, is_number, require_all
from dic.typing import Float

_SHORTEST_PX, _LONGEST_PX = 10.0, 1e5
_STRONGEST = 0.2
_ITERATIONS = 60
"""Each iteration of `Wave.origin` reduces the error by the strain's amplitude or more: 0.2⁶⁰ is nothing."""


@dataclass(frozen=True)
class Wave:
    """The displacement u = a sin(2π x / p + φ), v = a sin(2π y / p + φ) in the coordinates of the reference.

    The normal strains ∂u/∂x and ∂v/∂y are waves of the same period along the direction of the derivative.

    Attributes
    ----------
    period_px : float
        Period p.
    strain_amplitude : float
        Amplitude of ∂u/∂x and ∂v/∂y, which is 2π a / p.

    Raises
    ------
    CorrelationError
        If a value is out of range. The message names all wrong values together.
    """

    period_px: float = 100.0
    strain_amplitude: float = 0.005

    def __post_init__(self) -> None:
        checks = [
            (
                is_number(self.period_px) and _SHORTEST_PX <= self.period_px <= _LONGEST_PX,
                "period of the assumed strain",
                f"{_SHORTEST_PX:g} to {_LONGEST_PX:g} px",
                self.period_px,
                "give about twice the width of the smallest detail of the strain, such as 100 px",
            ),
            (
                is_number(self.strain_amplitude) and 0.0 < self.strain_amplitude <= _STRONGEST,
                "amplitude of the assumed strain",
                f"above 0 and at most {_STRONGEST:g}",
                self.strain_amplitude,
                "give 0.005 for a strain that varies by ±0.5 %",
            ),
        ]
        require_all(CorrelationError, "settings", checks)

    def displacement_px(self, at: Float, phase: float) -> Float:
        """Return the displacement along an axis at the coordinates `at`, px."""
        amplitude_px = self.strain_amplitude / self._per_px
        return np.asarray(amplitude_px * np.sin(self._per_px * at + phase))

    def gradient(self, at: Float, phase: float) -> Float:
        """Return the derivative of the displacement along its axis at the coordinates `at`."""
        return np.asarray(self.strain_amplitude * np.cos(self._per_px * at + phase))

    def origin(self, at: Float, phase: float) -> Float:
        """Return the coordinate in the reference of the material that the deformed image shows at `at`."""
        found = np.asarray(at, np.float64)
        for _ in range(_ITERATIONS):
            found = at - self.displacement_px(found, phase)
        return found

    @property
    def _per_px(self) -> float:
        return float(2.0 * np.pi / self.period_px)
