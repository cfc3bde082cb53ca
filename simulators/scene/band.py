"""A Lüders band: while a sheet yields discontinuously, a front travels along it from one end to the other.

Behind the front the sheet has the plastic strain of the whole plateau, ahead of it none. Therefore a gauge
sees nothing, then the strain of the band, then nothing, while the mean strain of the sheet grows steadily.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from drivers.settings import Settings
from simulators.scene.jit import compiled

Array = NDArray[np.float64]

_HALVINGS = 80
_NEWTON_STEPS = 30


class BandSettings(Settings):
    """Where a Lüders band begins, and how wide its front is."""

    start: Literal["lower", "upper"] = Field(default="lower", description="end at which the band begins")
    front_width_mm: float = Field(
        default=4.0, ge=0.2, le=50, description="length over which the plastic strain rises in the front"
    )


@dataclass(frozen=True)
class Band:
    """The plastic strain of a sheet along Y, behind, in and ahead of a front, and the uniform elastic strain.

    The front is a straight line across the sheet. In the front the plastic strain rises as a smooth step. The
    plastic strain of the width belongs to the plastic strain along Y at each place.

    Attributes
    ----------
    front_mm : float
        Material coordinate Y of the middle of the front.
    front_width_mm : float
    upward : bool
        True if the front travels towards +Y.
    strain : float
        Plastic engineering strain along Y behind the front.
    elastic, elastic_across : float
        Elastic strain along Y and along X, the same everywhere.
    narrowing : float
        Plastic stretch of the width = (1 + plastic strain along Y) ^ -narrowing.
    length_mm : float
        Length of the uniform part of the sheet, with its middle at Y = 0.
    """

    front_mm: float
    front_width_mm: float
    upward: bool
    strain: float
    elastic: float
    elastic_across: float
    narrowing: float
    length_mm: float

    def plastic_at(self, y_mm: Array | float) -> Array:
        """Return the plastic strain along Y at material coordinates Y in mm."""
        ahead_mm = self._way * (np.asarray(y_mm, dtype=np.float64) - self.front_mm)
        return np.asarray(self.strain * _step(-ahead_mm / self.front_width_mm))

    def strain_between(self, low_mm: float, high_mm: float) -> float:
        """Return the engineering strain along Y of a gauge between two material coordinates Y in mm."""
        plastic_mm = self._plastic_mm(high_mm) - self._plastic_mm(low_mm)
        return self.elastic + plastic_mm / (high_mm - low_mm)

    def strain_at(self, y_mm: float) -> float:
        """Return the engineering strain along Y at a material coordinate Y in mm."""
        return self.elastic + float(self.plastic_at(y_mm))

    @property
    def shift_mm(self) -> float:
        """Displacement of the middle of the sheet relative to the mean of that of its two ends."""
        half_mm = self.length_mm / 2
        return -(self._plastic_mm(half_mm) + self._plastic_mm(-half_mm)) / 2

    @property
    def elastic_gradient(self) -> Array:
        """Deformation gradient (2, 2) of the sheet ahead of the front."""
        return np.diag([1.0 + self.elastic_across, 1.0 + self.elastic])

    def stretched(self, material_mm: Array) -> Array:
        """Return where the plastic strain moves material points (n, 2), before the elastic strain."""
        return _stretched(np.ascontiguousarray(material_mm, dtype=np.float64), self._numbers)

    def material(self, stretched_mm: Array) -> Array:
        """Return the material points (n, 2) that `stretched` moves to points (n, 2)."""
        return _unstretched(np.ascontiguousarray(stretched_mm, dtype=np.float64), self._numbers)

    @property
    def _way(self) -> float:
        return 1.0 if self.upward else -1.0

    @property
    def _numbers(self) -> Array:
        return np.array(
            [
                self._way,
                self._way * self.front_mm,
                self.front_width_mm,
                self.strain,
                self.narrowing,
                1.0 + self.elastic,
                1.0 + self.elastic_across,
            ]
        )

    def _plastic_mm(self, y_mm: float) -> float:
        """Return the plastic change of the distance from the middle of the sheet."""
        front_mm = self._way * self.front_mm
        behind_mm = _area(front_mm, self.front_width_mm)
        passed_mm = _area(front_mm - self._way * y_mm, self.front_width_mm)
        return float(self._way * self.strain * (behind_mm - passed_mm))


def front_at(mean_plastic: float, strain: float, settings: BandSettings, length_mm: float) -> float:
    """Return the coordinate Y in mm of the front at which a sheet has a mean plastic strain.

    `strain` is the plastic strain behind the front, and `length_mm` the length of the sheet.
    """
    width_mm, half_mm = settings.front_width_mm, length_mm / 2
    low_mm, high_mm = -half_mm - width_mm / 2, half_mm + width_mm / 2
    wanted_mm = mean_plastic / strain * length_mm
    for _ in range(_HALVINGS):
        front_mm = (low_mm + high_mm) / 2
        behind_mm = _area(front_mm + half_mm, width_mm) - _area(front_mm - half_mm, width_mm)
        low_mm, high_mm = (front_mm, high_mm) if behind_mm < wanted_mm else (low_mm, front_mm)
    return front_mm if settings.start == "lower" else -front_mm


def _step(x: Array) -> Array:
    """Return a smooth step from 0 at x = -1/2 to 1 at x = 1/2."""
    q = np.clip(x + 0.5, 0.0, 1.0)
    return np.asarray(q * q * (3.0 - 2.0 * q))


@compiled
def _area(x_mm: float, width_mm: float) -> float:
    """Return the integral of the smooth step up to a point `x_mm` beyond its middle."""
    q = min(max(x_mm / width_mm + 0.5, 0.0), 1.0)
    return width_mm * (q * q * q - 0.5 * q * q * q * q) + max(x_mm - 0.5 * width_mm, 0.0)


@compiled
def _share(x_mm: float, width_mm: float) -> float:
    """Return the smooth step at a point `x_mm` beyond its middle."""
    q = min(max(x_mm / width_mm + 0.5, 0.0), 1.0)
    return q * q * (3.0 - 2.0 * q)


@compiled
def _width_stretch(share: float, numbers: Array) -> float:
    """Return the stretch of the width where the plastic strain is a share of that behind the front."""
    plastic, across = share * numbers[3], numbers[6]
    return float(1.0 + ((1.0 + plastic) ** (-numbers[4]) - 1.0) / across)


@compiled
def _stretched(points_mm: Array, numbers: Array) -> Array:
    way, front_mm, width_mm = numbers[0], numbers[1], numbers[2]
    # The elastic stretch follows. Divided by it, the plastic strain adds to the elastic strain.
    strain = numbers[3] / numbers[5]
    found = np.empty_like(points_mm)
    for i in range(len(points_mm)):
        along_mm = way * points_mm[i, 1]
        plastic_mm = strain * (_area(front_mm, width_mm) - _area(front_mm - along_mm, width_mm))
        stretch = _width_stretch(_share(front_mm - along_mm, width_mm), numbers)
        found[i, 0] = points_mm[i, 0] * stretch
        found[i, 1] = way * (along_mm + plastic_mm)
    return found


@compiled
def _unstretched(points_mm: Array, numbers: Array) -> Array:
    """Invert `_stretched`: exactly ahead of and behind the front, and by Newton's method within it."""
    way, front_mm, width_mm = numbers[0], numbers[1], numbers[2]
    strain = numbers[3] / numbers[5]
    behind_mm = _area(front_mm, width_mm)
    found = np.empty_like(points_mm)
    for i in range(len(points_mm)):
        goal_mm = way * points_mm[i, 1] - strain * behind_mm
        # goal = along - strain · area(front - along)
        along_mm = goal_mm
        if along_mm < front_mm + 0.5 * width_mm:
            along_mm = (goal_mm + strain * front_mm) / (1.0 + strain)
            if along_mm > front_mm - 0.5 * width_mm:
                for _ in range(_NEWTON_STEPS):
                    ahead_mm = front_mm - along_mm
                    error_mm = along_mm - strain * _area(ahead_mm, width_mm) - goal_mm
                    change_mm = error_mm / (1.0 + strain * _share(ahead_mm, width_mm))
                    along_mm -= change_mm
                    if abs(change_mm) < 1e-14 * (1.0 + abs(along_mm)):
                        break
        stretch = _width_stretch(_share(front_mm - along_mm, width_mm), numbers)
        found[i, 0] = points_mm[i, 0] / stretch
        found[i, 1] = way * along_mm
    return found
