"""The alignment of a rotation stage: tilts of the specimen and of the stage's axis relative to the grid."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from dic.errors import CalibrationError
from dic.files.reading import read_text
from dic.files.writing import write_text
from dic.out_of_plane.plane import Plane, turned
from dic.typing import Float, PathLike

_FORMAT = "offaxis-alignment"
_SMALL = 1e-6
"""Step in the slopes by which numerical derivatives are computed."""


@dataclass(frozen=True)
class Alignment:
    """The alignment of a rotation stage: slopes of the specimen and of the stage's axis.

    All slopes are relative to the calibration grid. The slopes depend on the fixture that holds the specimen.
    So an alignment can be used for other runs with the same fixture.

    Attributes
    ----------
    slopes : ndarray, shape (4,)
        Slopes x and y of the specimen's plane in the reference, then slopes x and y of the stage's axis. The
        axis has the direction (slope x, slope y, 1).
    covariance : ndarray, shape (4, 4)
        Covariance of the slopes.
    pivot_mm : ndarray, shape (2,)
        X and Y at which the stage's axis passes through the specimen.
    """

    slopes: Float
    covariance: Float
    pivot_mm: Float

    def __repr__(self) -> str:
        pairs = zip(self.wobble_deg, self.wobble_std_deg, strict=True)
        wobble = " and ".join(f"{value:z.3f} ± {std:.3f}°" for value, std in pairs)
        return f"Alignment(wobble {wobble}, axis at {self.pivot_mm[0]:.3f}, {self.pivot_mm[1]:.3f} mm)"

    @property
    def before(self) -> Plane:
        """The specimen's plane in the reference image, with the height 0 at the grid's centre."""
        return Plane(float(self.slopes[0]), float(self.slopes[1]))

    def after(self, angle_deg: float) -> Plane:
        """Return the specimen's plane after a rotation of the stage by `angle_deg`, positive from X to Y."""
        before = self.before
        axis = np.array([*self.slopes[2:], 1.0])
        x, y = self.pivot_mm
        on_axis = np.array([x, y, before.slope_x * x + before.slope_y * y])
        angle = np.radians(angle_deg)
        normal = turned(
            before.normal, axis / np.linalg.norm(axis), float(np.sin(angle)), float(np.cos(angle))
        )
        return Plane.across(normal, on_axis)

    def after_std(self, angle_deg: float) -> Float:
        """Return the standard deviations of the specimen's two slopes after a rotation, shape (2,)."""
        columns = []
        for step in _SMALL * np.eye(4):
            ahead, behind = (
                Alignment(self.slopes + sign * step, self.covariance, self.pivot_mm).after(angle_deg)
                for sign in (1, -1)
            )
            columns.append([ahead.slope_x - behind.slope_x, ahead.slope_y - behind.slope_y])
        by_slope = np.array(columns).T / (2 * _SMALL)
        return np.asarray(np.sqrt(np.diag(by_slope @ self.covariance @ by_slope.T)))

    @property
    def wobble_deg(self) -> Float:
        """Wobble in degrees: slopes x and y of the stage's axis relative to the specimen's normal, (2,)."""
        # The normal of a plane with slopes (a, b) is tilted by (-a, -b).
        return np.asarray(np.degrees(np.arctan(self.slopes[2:] + self.slopes[:2])))

    @property
    def wobble_std_deg(self) -> Float:
        """Standard deviations of `wobble_deg`, shape (2,)."""
        both = np.hstack([np.eye(2), np.eye(2)])
        return np.asarray(np.degrees(np.sqrt(np.diag(both @ self.covariance @ both.T))))

    def as_dict(self) -> dict[str, Any]:
        """Return the alignment in degrees and mm, as a dictionary for JSON; see `docs/results.md`."""
        degrees = np.degrees(np.arctan(self.slopes))
        std = np.degrees(np.sqrt(np.diag(self.covariance)))
        names = ("specimen_slope_x_deg", "specimen_slope_y_deg", "axis_slope_x_deg", "axis_slope_y_deg")
        summary = dict(zip(names, degrees.tolist(), strict=True))
        summary |= {f"{name}_std": value for name, value in zip(names, std.tolist(), strict=True)}
        summary |= dict(zip(("wobble_x_deg", "wobble_y_deg"), self.wobble_deg.tolist(), strict=True))
        wobble_std = self.wobble_std_deg.tolist()
        summary |= dict(zip(("wobble_x_deg_std", "wobble_y_deg_std"), wobble_std, strict=True))
        return summary | dict(zip(("axis_x_mm", "axis_y_mm"), self.pivot_mm.tolist(), strict=True))

    def as_lists(self) -> dict[str, Any]:
        """Return the attributes as lists for JSON."""
        return {name: np.asarray(value).tolist() for name, value in vars(self).items()}

    @classmethod
    def from_lists(cls, lists: Mapping[str, Any]) -> "Alignment":
        """Return the alignment from the lists that `as_lists` returned."""
        return cls(**{name: np.array(values, np.float64) for name, values in lists.items()})


def _is_possible(slopes: Float, covariance: Float) -> bool:
    """Return True if no slope is above 45°, and `covariance` is symmetric without negative eigenvalues."""
    rounding = 1e-9 * np.abs(covariance).max()
    symmetric = np.abs(covariance - covariance.T).max() <= rounding
    return bool(np.abs(slopes).max() <= 1.0 and symmetric and np.linalg.eigvalsh(covariance)[0] >= -rounding)


def save_alignment(alignment: Alignment, path: PathLike) -> None:
    """Write an alignment to a JSON file, for other runs on the same fixture."""
    content = {"file_format": _FORMAT} | alignment.as_lists()
    write_text(path, json.dumps(content, indent=1))


def load_alignment(path: PathLike) -> Alignment:
    """Read an alignment written by `save_alignment`.

    Raises
    ------
    CalibrationError
        If the file is missing, contains no alignment, or contains impossible values, such as slopes above
        45°.
    """
    path = Path(path)
    shapes = {"slopes": (4,), "covariance": (4, 4), "pivot_mm": (2,)}
    try:
        content = json.loads(read_text(path))
        values = {name: np.array(content[name], np.float64) for name in shapes}
        sound = all(values[n].shape == s and np.isfinite(values[n]).all() for n, s in shapes.items())
        if content.get("file_format") != _FORMAT or not sound:
            got = "a file of another kind"
        elif not _is_possible(values["slopes"], values["covariance"]):
            got = "slopes over 45° or a covariance that is none"
        else:
            return Alignment(**values)
    except FileNotFoundError:
        got = "no such file"
    except OSError as error:
        got = error.strerror or str(error)
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        got = "a file that is no alignment or was cut off"
    raise CalibrationError(
        str(path),
        "read alignment",
        "an alignment that was solved from a rotation",
        got,
        "make it with --save-alignment",
    )
