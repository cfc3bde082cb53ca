"""Knowledge about a specimen's shift towards the camera; one camera cannot measure this shift.

If the grips let the specimen tilt about a hinge, the surface keeps its height at the hinge. A tilt with the
slopes a, b about a hinge at (X, Y) then shifts the surface above the grid's centre by -(a X + b Y). So a
measured tilt gives this part of the shift.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from dic.out_of_plane.expected_shift import HINGE_STD_UM, SHIFT_STD_UM
from dic.out_of_plane.plane import Plane
from dic.typing import Float


@dataclass(frozen=True)
class Shift:
    """Knowledge about the specimen's shift towards the camera since the reference."""

    std_um: float = SHIFT_STD_UM
    """Standard deviation of the shift. If there is a hinge: standard deviation of the part of the shift that
    the tilt does not cause.
    """
    hinge_mm: tuple[float, float] | None = None
    """X and Y, in the grid's axes, of a point at which the surface keeps its height. None if such a point is
    not known.
    """

    @classmethod
    def of(cls, std_um: float | None, hinge_mm: tuple[float, float] | None) -> "Shift":
        """Return a `Shift`, with the default standard deviation if `std_um` is None."""
        default_um = SHIFT_STD_UM if hinge_mm is None else HINGE_STD_UM
        return cls(default_um if std_um is None else float(std_um), hinge_mm)

    def as_dict(self) -> dict[str, Any]:
        """Return the standard deviation and the hinge under the names of the options, for JSON."""
        hinge_mm = None if self.hinge_mm is None else list(self.hinge_mm)
        return {"shift_std_um": self.std_um, "tilt_axis_mm": hinge_mm}

    @property
    def text(self) -> str:
        """The knowledge of the shift as text, for reports."""
        if self.hinge_mm is None:
            return f"± {self.std_um:g} µm for one camera"
        x, y = self.hinge_mm
        return f"that of a tilt about a hinge at {x:g}, {y:g} mm, ± {self.std_um:g} µm, for one camera"

    @property
    def std_mm(self) -> float:
        """The value `std_um` in mm."""
        return 1e-3 * self.std_um

    @property
    def per_slope_mm(self) -> Float:
        """Shift above the grid's centre that a unit of each slope causes, shape (2,), mm."""
        return np.zeros(2) if self.hinge_mm is None else -np.array(self.hinge_mm)

    def plane(self, slope_x: float, slope_y: float) -> Plane:
        """Return the plane of a specimen that tilted by these slopes, about the hinge if there is one."""
        return Plane(slope_x, slope_y, float(self.per_slope_mm @ [slope_x, slope_y]))

    def plane_std_mm(self, slope_std: Float) -> float:
        """Return the standard deviation of the plane's shift, given those of its slopes (2,).

        The absolute errors of the slopes are added, because their correlation is not known. Without a hinge
        the shift of the plane is not known, and the result is NaN.
        """
        if self.hinge_mm is None:
            return float("nan")
        return float(np.hypot(np.abs(self.per_slope_mm) @ slope_std, self.std_mm))
