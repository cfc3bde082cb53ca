"""Where the points of a field are drawn: on the reference or the deformed image, in px or mm."""

from dataclasses import dataclass

import numpy as np

from dic.correlation.field import Field
from dic.errors import CorrelationError
from dic.pictures.settings import MapSettings
from dic.strain.measurement import Measurement
from dic.typing import Float

_CORNERS = ((0, 0), (0, 1), (1, 0), (1, 1))
_DETERMINED = 1e-9
"""Least ratio of eigenvalues at which points determine a homography uniquely; see `_determine_homography`.
Points on a line give 1e-16, and a grid of 2 × 1000 points gives 0.1.
"""


@dataclass(frozen=True)
class PointCells:
    """Cells around the points of a field, as they are drawn."""

    corners: Float
    """Shape (rows + 1, columns + 1, 2). Corners of the cells in the image, px. The cell [i, j] belongs to the
    point [i, j].
    """
    to_axes: Float
    """Shape (3, 3). Homography from the image's pixels to the axes of the picture."""
    unit: str | None
    """Unit of the axes, "px" or "mm"; None for a picture without axes."""
    view: tuple[float, float, float, float] | None = None
    """Least and largest x, then least and largest y of a picture. None for limits a little beyond the cells.
    """

    def drawn_corners(self) -> Float:
        """Return the corners of the cells in the axes, shape (rows + 1, columns + 1, 2)."""
        return mapped(self.to_axes, self.corners)


def places_of(measurement: Measurement, settings: MapSettings) -> PointCells:
    """Return where the points of a measurement are drawn.

    The axes "auto" are in px if there is no calibration, or if the points do not determine how to rectify the
    image.

    Raises `CorrelationError` if axes in mm are asked for, but there is no calibration, or the points do not
    determine the axes.
    """
    corners = _cell_corners(measurement.field, deformed=settings.on == "deformed")
    settings.require_calibration(settings.axes, calibrated=measurement.calibrated is not None)
    if measurement.calibrated is None or settings.axes not in ("auto", "mm"):
        return PointCells(corners, np.eye(3), None if settings.axes == "off" else "px")
    homography = _homography(measurement.field.points, measurement.calibrated.position)
    if homography is not None:
        return PointCells(corners, homography, "mm")
    if settings.axes == "auto":
        return PointCells(corners, np.eye(3), "px")
    raise CorrelationError(
        measurement.label,
        "draw axes in mm",
        "at least four points, all but one of which are not on one line",
        f"{len(measurement.field.points)} points",
        "measure more points with a smaller step, or give --map-axes px",
    )


def mapped(homography: Float, points: Float) -> Float:
    """Return points (…, 2) mapped by a homography (3, 3)."""
    ends = np.concatenate([points, np.ones((*points.shape[:-1], 1))], axis=-1) @ homography.T
    return np.asarray(ends[..., :2] / ends[..., 2:])


def _homography(points_px: Float, position_mm: Float) -> Float | None:
    """Return the least squares homography from pixels to mm; None if the points do not determine it.

    The homography rectifies the picture. The homography does not contain the lens distortion, which does not
    shift points visibly.
    """
    import cv2

    there = position_mm.reshape(-1, 2)
    known = np.isfinite(there).all(axis=1)
    if not _determine_homography(points_px[known]):
        return None
    homography, _ = cv2.findHomography(points_px[known], there[known], 0)
    return None if homography is None else np.asarray(homography, np.float64)


def _determine_homography(points: Float) -> bool:
    """Return True if only one homography fits the points (n, 2) and their images.

    The images of the points do not matter: the linear equations of a homography (Hartley and Zisserman,
    Multiple View Geometry, section 4.1) have the same rank for all possible images. So the function uses each
    point as its own image.
    """
    if len(points) < 4:
        return False
    spread = points.std(axis=0)
    x, y = ((points - points.mean(axis=0)) / np.where(spread > 0.0, spread, 1.0)).T
    one, zero = np.ones_like(x), np.zeros_like(x)
    equations = np.concatenate(
        [
            np.stack([x, y, one, zero, zero, zero, -x * x, -x * y, -x], axis=1),
            np.stack([zero, zero, zero, x, y, one, -x * y, -y * y, -y], axis=1),
        ]
    )
    # The least of the nine eigenvalues is 0 for every exact homography, so the second least decides.
    eigenvalues = np.linalg.eigvalsh(equations.T @ equations)
    return bool(eigenvalues[1] > _DETERMINED * eigenvalues[-1])


def _cell_corners(field: Field, *, deformed: bool) -> Float:
    """Return the corners of the cells around the points, px, shape (rows + 1, columns + 1, 2).

    On the deformed image, each neighbouring point predicts the position of a corner from its displacement and
    gradient. The result is the mean of up to four predictions.
    """
    x, y = (_between(along.astype(np.float64)) for along in (field.x_px, field.y_px))
    corners = np.stack(np.meshgrid(x, y), axis=-1)
    if not deformed:
        return corners
    rows, columns = field.status.shape
    total, count = np.zeros_like(corners), np.zeros(corners.shape[:2])
    points = field.points.reshape(rows, columns, 2).astype(np.float64)
    shift = np.stack([field.u_px, field.v_px], axis=-1)
    # A field that was read from a result file may have no gradients. Its cells then keep their shape.
    gradient = np.nan_to_num(field.gradient).reshape(rows, columns, 2, 2)
    for down, right in _CORNERS:
        window = slice(down, down + rows), slice(right, right + columns)
        away = corners[window] - points
        moved = shift + np.einsum("...ij,...j->...i", gradient, away)
        known = np.isfinite(moved).all(axis=-1)
        total[window] += np.where(known[..., None], moved, 0.0)
        count[window] += known
    # Corners without a measured neighbour belong to cells that are not drawn.
    return np.asarray(corners + total / np.maximum(count, 1.0)[..., None])


def _between(positions: Float) -> Float:
    """Return the limits between cells around n positions, shape (n + 1,); a single cell is 1 px wide."""
    middle = (positions[1:] + positions[:-1]) / 2
    half = (positions[1] - positions[0]) / 2 if positions.size > 1 else 0.5
    return np.concatenate([[positions[0] - half], middle, [positions[-1] + half]])
