"""Values of a camera that the user knows, as additional equations for the fit of a pinhole model."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dic.errors import CalibrationError, Check, require_all
from dic.typing import Float

PRINCIPAL_SHARE = 0.01
"""Standard deviation of a principal point that is not given, as a fraction of the image's width."""

# Machine vision lenses have focal lengths of about 1 to 10 image widths. This expectation has little weight,
# but it keeps the focal length finite if neither images nor given values determine the focal length.
_USUAL_WIDTHS = 3.0
_USUAL_LOG_STD = math.log(3.0)
# Standard deviation of a value that is given as exact. For the principal point the number is in px; for focal
# length and distance it is a fraction of the value.
_EXACTLY = 1e-6
# A larger deviation from a known value, in standard deviations, is reported as a contradiction.
_TOO_FAR = 5.0


@dataclass(frozen=True)
class KnownCamera:
    """The values of a camera that the user knows. A standard deviation of 0 means an exact value.

    Attributes
    ----------
    focal_px, focal_std_px : float
        Focal length, if known, and its standard deviation.
    distance_mm, distance_std_mm : float
        Distance of the pinhole from the grid's centre in the first image, if known, and its standard
        deviation.
    principal_px : sequence of float
        Coordinates of the principal point; by default the middle of the image.
    principal_std_px : float
        Standard deviation of each coordinate of the principal point. The default is 0 if the principal point
        is given, and 1 % of the image's width otherwise.

    Raises
    ------
    CalibrationError
        If a value is out of range, or if a standard deviation is given without its value. The message lists
        all mistakes.
    """

    focal_px: float | None = None
    focal_std_px: float = 0.0
    distance_mm: float | None = None
    distance_std_mm: float = 0.0
    principal_px: Sequence[float] | None = None
    principal_std_px: float | None = None

    def __post_init__(self) -> None:
        at, std = self.principal_px, self.principal_std_px
        checks = [
            *_length_checks("focal", "focal length", self.focal_px, self.focal_std_px, "px"),
            *_length_checks("distance", "working distance", self.distance_mm, self.distance_std_mm, "mm"),
            (
                at is None or (len(at) == 2 and all(math.isfinite(value) for value in at)),
                "principal point",
                "two finite numbers, px",
                at,
                "give --principal-px X Y, such as 499.5 399.5, or leave it out",
            ),
            (
                std is None or 0 <= std < math.inf,
                "standard deviation of the principal point",
                "0 px or more",
                f"{std} px",
                "give --principal-std-px 0 for an exact value, or more",
            ),
        ]
        require_all(CalibrationError, "settings", checks)

    def prior(self, image_shape: tuple[int, ...]) -> "Prior":
        """Return the equations by which known values enter the fit; `image_shape` is (height, width)."""
        height, width = image_shape[:2]
        at = ((width - 1) / 2, (height - 1) / 2) if self.principal_px is None else self.principal_px
        std = self.principal_std_px
        if std is None:
            std = PRINCIPAL_SHARE * width if self.principal_px is None else 0.0
        return Prior(self, np.array(at, np.float64), max(std, _EXACTLY), _USUAL_WIDTHS * width)


@dataclass(frozen=True)
class Prior:
    """Equations for known camera values: each deviation from a value is divided by its standard deviation."""

    known: KnownCamera
    principal_px: Float
    """Shape (2,). The given principal point, or else the middle of the image."""
    principal_std_px: float
    """Standard deviation of each coordinate of the principal point."""
    usual_focal_px: float
    """Expected focal length if the user gives no focal length."""

    def contradiction(self, parameters: Float) -> str:
        """Return a text about the first given value that contradicts the fit, or "" if there is none.

        A value contradicts the fit if the two differ by more than five standard deviations.
        """
        names = ["principal point's x", "principal point's y"]
        # A deviation from the usual focal length is not a contradiction, because the user did not give this
        # value.
        names.append("usual focal length" if self.known.focal_px is None else "given focal length")
        names.append("given distance")
        for name, off in zip(names, self.equations(parameters)[0], strict=False):
            if abs(off) > _TOO_FAR and not name.startswith("usual"):
                return f"a {name} that is {abs(off):.0f} standard deviations off"
        return ""

    def equations(self, parameters: Float) -> tuple[Float, Float]:
        """Return the m deviations from known values, and their derivatives, shapes (m,) and (m, parameters).

        The module `dic.calibration.pinhole.model` describes the order of `parameters`.
        """
        off, slopes = [], []

        def add(deviation: float, std: float, **derivatives: float) -> None:
            row = np.zeros(len(parameters))
            for name, value in derivatives.items():
                row[_PLACES[name]] = value / std
            off.append(deviation / std)
            slopes.append(row)

        log_focal, x, y = parameters[:3]
        focal = float(np.exp(log_focal))
        add(x - self.principal_px[0], self.principal_std_px, x=1.0)
        add(y - self.principal_px[1], self.principal_std_px, y=1.0)
        given = self.known.focal_px
        if given is None:
            add(log_focal - math.log(self.usual_focal_px), _USUAL_LOG_STD, log_focal=1.0)
        else:
            add(focal - given, max(self.known.focal_std_px, _EXACTLY * given), log_focal=focal)
        away = self.known.distance_mm
        if away is not None:
            a, b, log_scale = parameters[10:13]
            square = a * a + b * b + focal * focal
            distance = float(np.sqrt(square) * np.exp(-log_scale))
            share = distance / square
            std = max(self.known.distance_std_mm, _EXACTLY * away)
            add(
                distance - away,
                std,
                log_focal=share * focal**2,
                a=share * a,
                b=share * b,
                log_scale=-distance,
            )
        return np.array(off), np.array(slopes)


_PLACES = {"log_focal": 0, "x": 1, "y": 2, "a": 10, "b": 11, "log_scale": 12}


def _length_checks(option: str, name: str, value: float | None, std: float, unit: str) -> list[Check]:
    """Return checks of a known length and of its standard deviation, in the form that `require_all` takes."""
    return [
        (
            value is None or 0 < value < math.inf,
            name,
            f"above 0 {unit}",
            f"{value} {unit}",
            f"give --{option}-{unit} 1000, or leave it out",
        ),
        (
            0 <= std < math.inf,
            f"standard deviation of the {name}",
            f"0 {unit} or more",
            f"{std} {unit}",
            f"give --{option}-std-{unit} 0 for an exact value, or more",
        ),
        (
            value is not None or not std > 0,
            name,
            "a value that goes with its standard deviation",
            f"only the standard deviation, {std} {unit}",
            f"give --{option}-{unit} too, or leave out --{option}-std-{unit}",
        ),
    ]
