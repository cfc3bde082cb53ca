"""The curve of first loading of the virtual specimen: nominal stress and plastic strain along one path.

A parameter in MPa, the path, numbers the points of the curve in order. Neither stress nor plastic strain
could do this alone: the stress falls after an upper yield point, and the plastic strain is zero in the whole
elastic part.
"""

from dataclasses import dataclass
from functools import cached_property
from math import log
from typing import Protocol

from simulators.scene.hardening import FlowCurve

# The yield stress is the stress at this plastic strain (0.2 % offset).
YIELD_STRAIN = 0.002


@dataclass(frozen=True)
class Point:
    """A point of the first loading."""

    stress_mpa: float  # load over the original area
    plastic: float  # engineering strain that remains after unloading
    highest_mpa: float  # the highest stress up to this point
    # derivatives of `stress_mpa` and of `plastic` along the path
    stress_slope: float
    plastic_slope: float


class FirstLoading(Protocol):
    """A curve of first loading."""

    def at(self, path_mpa: float) -> Point:
        """Return the point at a path of at least 0."""


@dataclass(frozen=True)
class RambergOsgood:
    """The law of Ramberg and Osgood: ``plastic = 0.002 (stress / yield stress)^n``. The path is the stress.

    The exponent n is such that the plastic strain at the ultimate stress is `plastic_at_ultimate`.
    """

    yield_stress_mpa: float
    ultimate_stress_mpa: float
    plastic_at_ultimate: float

    @cached_property
    def exponent(self) -> float:
        """The exponent n."""
        return log(self.plastic_at_ultimate / YIELD_STRAIN) / log(
            self.ultimate_stress_mpa / self.yield_stress_mpa
        )

    def at(self, path_mpa: float) -> Point:
        """Return the point at a stress."""
        n = self.exponent
        ratio = path_mpa / self.yield_stress_mpa
        slope = YIELD_STRAIN * n * ratio ** (n - 1.0) / self.yield_stress_mpa
        return Point(path_mpa, YIELD_STRAIN * ratio**n, path_mpa, 1.0, slope)


@dataclass(frozen=True)
class ByFlowCurve:
    """A curve that is linear elastic up to the beginning of plastic flow and then follows a flow curve.

    Up to the beginning of plastic flow, the path is the stress. Afterwards, the path grows by Young's modulus
    times the plastic strain.
    """

    flow: FlowCurve
    modulus_mpa: float

    def at(self, path_mpa: float) -> Point:
        """Return the point at a path."""
        if path_mpa <= self.flow.onset_mpa:
            return Point(path_mpa, 0.0, path_mpa, 1.0, 0.0)
        plastic = (path_mpa - self.flow.onset_mpa) / self.modulus_mpa
        return Point(
            self.flow.stress_mpa(plastic),
            plastic,
            self.flow.highest_mpa(plastic),
            self.flow.slope_mpa(plastic) / self.modulus_mpa,
            1.0 / self.modulus_mpa,
        )
