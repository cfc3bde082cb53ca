"""The deformation that a study assumes: a wave of strain along each axis."""

import math
from dataclasses import dataclass

import numpy as np

from dic.errors import CorrelationError, is_number, require_all
from dic.typing import Float

_SHORTEST_PX, _LONGEST_PX = 10.0, 1e5
_STRONGEST = 0.2

Phases = tuple[float, float]
"""The phases φ and ψ of a wave, rad."""

_ITERATIONS = 60
"""Number of iterations of `Wave.origin`; each multiplies the error by at most the largest displacement
gradient.
"""


@dataclass(frozen=True)
class Wave:
    """The displacement u = a sin(2π x/p + φ) cos(2π y/q + ψ), v = a sin(2π y/p + φ) cos(2π x/q + ψ).

    The coordinates x and y are measured in the reference image. The normal strains ∂u/∂x and ∂v/∂y are waves
    with the period p along the direction of the derivative, and with the period q across it.

    Attributes
    ----------
    period_px : float
        Period p.
    strain_amplitude : float
        Amplitude of ∂u/∂x and ∂v/∂y, which is 2π a / p.
    across_px : float
        Period q; infinite if the strain does not vary across the direction of the derivative.

    Raises
    ------
    CorrelationError
        If a value is out of range. The message names all wrong values together.
    """

    period_px: float = 100.0
    strain_amplitude: float = 0.005
    across_px: float = math.inf

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
                is_number(self.across_px) and self.across_px >= _SHORTEST_PX,
                "period of the assumed strain across its direction",
                f"at least {_SHORTEST_PX:g} px, or infinite",
                self.across_px,
                "leave it out for a strain that varies in its own direction only",
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

    def displacement_px(self, x: Float, y: Float, phases: Phases) -> Float:
        """Return the displacements u and v at places of the reference, shape (2, …)."""
        along, across, (first, second) = self._per_px, self._across_per_px, phases
        amplitude_px = self.strain_amplitude / along
        u = np.sin(along * x + first) * np.cos(across * y + second)
        v = np.sin(along * y + first) * np.cos(across * x + second)
        return np.asarray(amplitude_px * np.stack([u, v]))

    def gradient(self, x: Float, y: Float, phases: Phases) -> Float:
        """Return the displacement gradient ∂u_i/∂x_j at places of the reference, shape (…, 2, 2)."""
        along, across, (first, second) = self._per_px, self._across_per_px, phases
        slope, rows = across / along, []
        for own, other in ((x, y), (y, x)):
            own_derivative = np.cos(along * own + first) * np.cos(across * other + second)
            other_derivative = -slope * np.sin(along * own + first) * np.sin(across * other + second)
            rows.append((own_derivative, other_derivative))
        (u_x, u_y), (v_y, v_x) = rows
        gradient = np.stack([np.stack([u_x, u_y], axis=-1), np.stack([v_x, v_y], axis=-1)], axis=-2)
        return np.asarray(self.strain_amplitude * gradient)

    def origin(self, x: Float, y: Float, phases: Phases) -> tuple[Float, Float]:
        """Return the places in the reference of the material that the deformed image shows at (x, y)."""
        found_x, found_y = x, y
        for _ in range(_ITERATIONS):
            u, v = self.displacement_px(found_x, found_y, phases)
            found_x, found_y = x - u, y - v
        return found_x, found_y

    @property
    def is_plane(self) -> bool:
        """True if the strain varies only along its own direction: exx along x, eyy along y."""
        return math.isinf(self.across_px)

    @property
    def _per_px(self) -> float:
        return 2.0 * math.pi / self.period_px

    @property
    def _across_per_px(self) -> float:
        return 2.0 * math.pi / self.across_px
