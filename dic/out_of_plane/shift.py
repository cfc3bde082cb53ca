"""Knowledge about a specimen's shift towards the camera; one camera cannot measure this shift.

If the grips let the specimen tilt about a hinge, the surface keeps its height at the hinge. A tilt with the
slopes a, b about a hinge at (X, Y) then shifts the surface above the grid's centre by -(a X + b Y). So a
measured tilt gives this part of the shift. The thinning of the specimen under load gives another part
(`dic.out_of_plane.thinning`).
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from dic.out_of_plane.causes import main_direction, strain_along
from dic.out_of_plane.expected_shift import GRIP_MM, HINGE_STD_UM, SHIFT_STD_UM, TRAVEL_SHARE
from dic.out_of_plane.plane import Plane
from dic.out_of_plane.thinning import UNKNOWN_MM, recession_mm
from dic.out_of_plane.uncertainty import Points
from dic.typing import Float

_POISSON_RATIO = 0.33
"""Poisson's ratio for the thinning that is expected but not corrected."""


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
    thickness_mm: float | None = None
    """Thickness of the specimen before the test. If it is known, the shift by thinning is corrected."""
    fixed_face: str | None = None
    """The face that the grips hold: "middle", "back" or "front"; None if it is not known."""
    grows: bool = False
    """True if `std_um` is the default, which holds for the seating of the specimen in the grips only."""

    @classmethod
    def of(
        cls,
        std_um: float | None,
        hinge_mm: tuple[float, float] | None,
        thickness_mm: float | None = None,
        fixed_face: str | None = None,
    ) -> "Shift":
        """Return a `Shift`, with the default standard deviation if `std_um` is None."""
        default_um = SHIFT_STD_UM if hinge_mm is None else HINGE_STD_UM
        used_um = default_um if std_um is None else float(std_um)
        return cls(used_um, hinge_mm, thickness_mm, fixed_face, std_um is None)

    def during(self, points: Points, gradient: Float) -> "Shift":
        """Return the shift that is expected for the displacements of these points, and a gradient (2, 2).

        The default standard deviation grows with the thinning of a specimen whose thickness is not known, and
        with the travel of grips without a hinge.
        """
        if not self.grows:
            return self
        std_mm = self.std_mm
        if self.hinge_mm is None:
            way_mm = float(np.hypot(*(points.after_mm - points.before_mm).mean(axis=0)))
            strain = abs(strain_along(gradient, main_direction(gradient))[0])
            std_mm = float(np.hypot(std_mm, TRAVEL_SHARE * (way_mm + GRIP_MM * strain)))
        if self.thickness_mm is None:
            # At small strain the other shifts exceed that by thinning.
            std_mm = max(std_mm, self.thinned_mm(gradient))
        return replace(self, std_um=1e3 * std_mm, grows=False)

    def thinned_mm(self, gradient: Float) -> float:
        """Return the root mean square shift that thinning causes at a displacement gradient (2, 2)."""
        thickness_mm = UNKNOWN_MM if self.thickness_mm is None else self.thickness_mm
        return float(np.hypot(*recession_mm(gradient, _POISSON_RATIO, thickness_mm, self.fixed_face)))

    def as_dict(self) -> dict[str, Any]:
        """Return what is known under the names of the options, for JSON."""
        hinge_mm = None if self.hinge_mm is None else list(self.hinge_mm)
        known = {"thickness_mm": self.thickness_mm, "fixed_face": self.fixed_face}
        return {"shift_std_um": self.std_um, "tilt_axis_mm": hinge_mm} | known

    @property
    def text(self) -> str:
        """The knowledge of the shift as text, for reports."""
        known = []
        if self.hinge_mm is not None:
            x, y = self.hinge_mm
            known.append(f"that of a tilt about a hinge at {x:g}, {y:g} mm")
        if self.thickness_mm is not None:
            face = "an unknown face" if self.fixed_face is None else f"the {self.fixed_face}"
            known.append(f"that of the thinning of {self.thickness_mm:g} mm, held at {face}")
        grows = " and more with the travel of the grips" if self.grows else ""
        return ", ".join([*known, f"± {self.std_um:g} µm{grows}, for one camera"])

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
