"""Calibration of a camera: maps from image px to grid mm, valid within the area of the grid points."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal, get_args

import numpy as np

from dic.calibration.bicubic import BicubicMap
from dic.calibration.cross_validation import cross_validation_rms
from dic.calibration.grid_accuracy import KnownGrid, deviated
from dic.calibration.grid_making import EXACT, GridAccuracy
from dic.calibration.pinhole.camera import Pinhole, root
from dic.calibration.pinhole.fit import fit_pinholes
from dic.calibration.pinhole.prior import KnownCamera
from dic.calibration.residuals import PlaneMap, Residuals
from dic.errors import CalibrationError
from dic.targets.points import GridPoints
from dic.typing import Float, Indices, Mask

Model = Literal["bicubic", "pinhole"]

_CLEARLY_BETTER = 0.95
_NEGLIGIBLE_PX = 1e-4


_KEPT_POINTS = 100_000
"""Largest number of points whose calibrated positions in the reference are kept for the next image."""


@dataclass(frozen=True)
class FittedTo:
    """What a pinhole model is fitted to."""

    grids: tuple[GridPoints, ...]
    """The grid points of all images, at their nominal places."""
    image_shape: tuple[int, int]
    known: KnownCamera | None
    accuracy: GridAccuracy


@dataclass(frozen=True)
class Calibration:
    """The calibration of one camera: a bicubic map and a pinhole model, one of which is in use.

    Attributes
    ----------
    bicubic : BicubicMap
        The bicubic map of Helm and Deaner, from image px to grid mm.
    grid : GridPoints
        The grid points of the first image, to which the bicubic map was fitted.
    image_shape : tuple of int
        Height and width of the grid image, px.
    source : str
        The file of the grid image, or the camera and the run that recorded the grid image.
    pinhole : Pinhole or None
        The pinhole model, or None if no pinhole model could be fitted.
    pinhole_problem : str
        The reason why `pinhole` is None.
    bicubic_cross_validation_px : float
        Prediction error of the bicubic map: root mean square distance of left-out grid points from their
        prediction. NaN if the grid is too small for cross-validation.
    images : int
        Number of grid images. The grid's plane in the first image is the plane of the coordinates X and Y.
        Further images improve only the pinhole model.
    fitted_to : FittedTo or None
        What the pinhole model was fitted to; None in files of earlier versions.
    plate_mm : float
        Distance by which the plane of the coordinates X and Y lies behind the grid's lines.
    model : str
        The model in use, "bicubic" or "pinhole". The methods `map` and `jacobian` use this model, and so do
        the properties for residuals and scale.
    """

    bicubic: BicubicMap
    grid: GridPoints
    image_shape: tuple[int, int]
    source: str = ""
    pinhole: Pinhole | None = None
    pinhole_problem: str = "it was not fitted"
    bicubic_cross_validation_px: float = float("nan")
    images: int = 1
    fitted_to: "FittedTo | None" = None
    plate_mm: float = 0.0
    model: Model = "bicubic"

    def __repr__(self) -> str:
        scale = f"{self.grid.found} points, {self.rms_px:.4f} px rms, {1e3 * self.mm_per_px:.3f} µm/px"
        return f"Calibration({self.model}, {scale}, {self.source!r})"

    @classmethod
    def fit(
        cls,
        grid: GridPoints | Sequence[GridPoints],
        image_shape: tuple[int, ...],
        source: str = "",
        *,
        known: KnownCamera | None = None,
        accuracy: GridAccuracy = EXACT,
    ) -> "Calibration":
        """Fit the bicubic map and the pinhole model to the grid points of one image, or of several.

        Parameters
        ----------
        grid : GridPoints or sequence of GridPoints
            Grid points of each image. The grid's plane in the first image is the plane of the coordinates X
            and Y. Further images, in which the grid is tilted, improve the pinhole model.
        image_shape : tuple of int
            Height and width of the images, px.
        source : str
            The file of the grid image, or another text that names the origin of the calibration.
        known : KnownCamera, optional
            Prior knowledge of the camera, such as its focal length, for the fit of the pinhole model.
        accuracy : GridAccuracy, optional
            How accurately the grid was made.

        Raises
        ------
        CalibrationError
            If the grid points do not determine the bicubic map.
        """
        grids = (grid,) if isinstance(grid, GridPoints) else tuple(grid)
        return cls._of(FittedTo(grids, (image_shape[0], image_shape[1]), known, accuracy), source)

    @classmethod
    def _of(cls, to: "FittedTo", source: str, grid: KnownGrid | None = None) -> "Calibration":
        pinhole, problem = None, ""
        try:
            expected = KnownGrid.of(to.accuracy) if grid is None else grid
            pinhole = fit_pinholes(to.grids, to.image_shape, to.known, grid=expected)[0]
        except CalibrationError as error:
            problem = f"{error.step}: expected {error.expected}, got {error.got}"
        first, shared_mm = to.grids[0], None
        if pinhole is not None and pinhole.deviation_covariance.any():
            first, shared_mm = as_it_is(first, pinhole)
        return cls(
            BicubicMap.fit(first.uv_px, first.xy_mm, shared_mm),
            first,
            to.image_shape,
            source,
            pinhole,
            problem,
            _bicubic_cross_validation_px(first),
            len(to.grids),
            to,
        )

    def on_grid(self, grid: KnownGrid) -> "Calibration":
        """Return a calibration of the plane of the lines, fitted with other knowledge of their deviations.

        Raises `ValueError` if it is not known what this calibration was fitted to.
        """
        if self.fitted_to is None:
            raise ValueError("a calibration of an earlier version cannot be fitted again")
        return replace(Calibration._of(self.fitted_to, self.source, grid), model=self.model)

    def fitted_again(self, **changes: Any) -> "Calibration":
        """Return a calibration of the plane of the lines, fitted again with `changes` of `FittedTo`.

        Raises `CalibrationError` if it is not known what this calibration was fitted to.
        """
        if self.fitted_to is None:
            raise CalibrationError(
                self.source or "calibration",
                "fit the camera again",
                "a calibration that knows its grid's points",
                "one of an earlier version",
                "calibrate again from the image of the grid",
            )
        again = Calibration._of(replace(self.fitted_to, **changes), self.source)
        return replace(again, model=self.model)

    def using(self, model: Model) -> "Calibration":
        """Return the same calibration with the given model in use.

        Raises
        ------
        CalibrationError
            If `model` is not "bicubic" or "pinhole", or if the pinhole model could not be fitted.
        """
        source = self.source or "calibration"
        if model not in get_args(Model):
            raise CalibrationError(
                source, "use a model", "bicubic or pinhole", str(model), 'use "bicubic", the paper\'s'
            )
        if model == "pinhole" and self.pinhole is None:
            raise CalibrationError(
                source,
                "use the pinhole model",
                "a fitted pinhole model",
                f"none, because {self.pinhole_problem}",
                "use --model bicubic, or calibrate again with more lines or more images of the grid",
            )
        if model == self.model:
            return self
        if model not in self._others:
            # What is kept of it serves the next image, too.
            self._others[model] = replace(self, model=model)
        return self._others[model]

    @property
    def recommended(self) -> Model:
        """The model with the smaller cross-validation error; the bicubic map if the difference is unclear."""
        if self.pinhole is None:
            return "bicubic"
        # A bicubic map without cross-validation is not recommended if there is a pinhole model.
        bicubic_px = np.nan_to_num(self.bicubic_cross_validation_px, nan=np.inf)
        limit_px = _CLEARLY_BETTER * bicubic_px - _NEGLIGIBLE_PX
        return "pinhole" if self.pinhole.cross_validation_px < limit_px else "bicubic"

    @property
    def recommendation(self) -> str:
        """One sentence that names the recommended model and the reason."""
        if self.pinhole is None:
            return f"bicubic: there is no pinhole model ({self.pinhole_problem})"
        bicubic, pinhole = self.bicubic_cross_validation_px, self.pinhole.cross_validation_px
        if np.isnan(bicubic):
            return (
                f"pinhole: predicts left-out points to {pinhole:.4f} px; the test of bicubic needs more lines"
            )
        if self.recommended == "pinhole":
            return f"pinhole: predicts left-out points to {pinhole:.4f} px, bicubic to {bicubic:.4f} px"
        figures = f"bicubic: predicts left-out points to {bicubic:.4f} px, pinhole to {pinhole:.4f} px"
        clear = bicubic < _CLEARLY_BETTER * pinhole - _NEGLIGIBLE_PX
        return figures if clear else f"{figures}: without a clear difference, use the paper's model"

    def map(self, px: Float) -> Float:
        """Return grid coordinates (n, 2) in mm of image points (n, 2) in px; NaN stays NaN.

        The map is reliable only within the calibrated area; `inside` returns the points in this area.
        """
        return self._in_use.map(px)

    def jacobian(self, px: Float) -> Float:
        """Return the Jacobian ``∂(X, Y)/∂(x, y)`` in mm/px at image points (n, 2), shape (n, 2, 2)."""
        return self._in_use.jacobian(px)

    def map_and_jacobian(self, px: Float) -> tuple[Float, Float]:
        """Return the results of `map` and `jacobian`."""
        if isinstance(self._in_use, Pinhole):
            return self._in_use.map_and_jacobian(px)
        return self.map(px), self.jacobian(px)

    def error_factors(self, px: Float) -> Float:
        """Return a matrix F for each image point (n, 2); F Fᵀ is the error covariance of the mapped point.

        The result has the shape (n, 2, q) and the unit mm. The matrix F follows from the scatter of the grid
        points in the image. Each column of F is one source of error that all points share. So if two mapped
        points have the matrices F₁ and F₂, their distance vector has the matrix F₂ - F₁.
        """
        return self._in_use.error_factors(px)

    def inside(self, px: Float) -> Mask:
        """Return True for image points (n, 2) within the calibrated area, and False outside and for NaN.

        The calibrated area is the polygon of the outermost grid points, for the bicubic map and for the
        pinhole model. Outside this area the bicubic map "quickly deviates from the desired values" (Helm and
        Deaner). Outside the calibrated area there are no grid points, so the pinhole model cannot be tested
        there. So every result of a measurement marks the points that lie outside the calibrated area.
        """
        points = np.asarray(px, np.float64).reshape(-1, 2)
        # After sorting by y, the points between the two ends of an edge follow one another, and NaN comes
        # last.
        order = np.argsort(points[:, 1], kind="stable")
        x, y = points[order].T
        odd = np.zeros(len(points), bool)
        outline = self.outline_px
        for start, end in zip(outline, np.roll(outline, -1, axis=0), strict=True):
            if start[1] == end[1]:
                continue
            beside = slice(*np.searchsorted(y, sorted((start[1], end[1]))))
            slope = (end[0] - start[0]) / (end[1] - start[1])
            odd[beside] ^= x[beside] < start[0] + slope * (y[beside] - start[1])
        inside = np.zeros(len(points), bool)
        inside[order] = odd
        return inside

    def on_points(self, x_px: Indices, y_px: Indices) -> tuple[Float, Mask]:
        """Return `map` and `inside` of a grid of points with the given columns and rows.

        They are kept until other points are asked for, because all images of a series have the same points.
        """
        key, last = (x_px.tobytes(), y_px.tobytes()), self._last_points.get("last")
        if last is not None and last[0] == key:
            return last[1]
        x, y = np.meshgrid(x_px, y_px)
        px = np.column_stack([x.ravel(), y.ravel()]).astype(np.float64)
        found = self.map(px), self.inside(px)
        if len(px) <= _KEPT_POINTS:
            self._last_points["last"] = key, found
        return found

    @cached_property
    def _last_points(self) -> dict[str, tuple[tuple[bytes, bytes], tuple[Float, Mask]]]:
        return {}

    @cached_property
    def _others(self) -> dict[str, "Calibration"]:
        return {}

    @cached_property
    def outline_px(self) -> Float:
        """Corners of the polygon around the calibrated area, in order along the edge, shape (m, 2), px."""
        return self.grid.outline_px()

    @cached_property
    def residuals(self) -> dict[Model, Residuals]:
        """The residuals at the grid points, for each calibration model ("bicubic" and "pinhole")."""
        residuals: dict[Model, Residuals] = {"bicubic": Residuals.of(self.bicubic, self.grid)}
        if self.pinhole is not None:
            residuals["pinhole"] = Residuals.of(self.pinhole, self.grid)
        return residuals

    @property
    def residual_mm(self) -> Float:
        """Mapped minus true position of every grid point, for the model in use, shape (n, 2), mm."""
        return self.residuals[self.model].mm

    @property
    def residual_px(self) -> Float:
        """The residuals of the model in use, converted to image pixels, shape (n, 2), px."""
        return self.residuals[self.model].px

    @property
    def rms_mm(self) -> float:
        """Root mean square length of `residual_mm`."""
        return self.residuals[self.model].rms_mm

    @property
    def rms_px(self) -> float:
        """Root mean square length of `residual_px`."""
        return self.residuals[self.model].rms_px

    @property
    def max_mm(self) -> float:
        """Largest length of `residual_mm`."""
        return self.residuals[self.model].max_mm

    @property
    def max_px(self) -> float:
        """Largest length of `residual_px`."""
        return self.residuals[self.model].max_px

    @property
    def mm_per_px(self) -> float:
        """Scale at the middle of the grid, mm/px: the square root of the grid area that one pixel covers."""
        middle = self.grid.uv_px.mean(axis=0, keepdims=True)
        return float(np.sqrt(abs(np.linalg.det(self.jacobian(middle)[0]))))

    @property
    def lens_remainder_px(self) -> float:
        """Rms distortion at the grid points that the usual terms of a lens do not describe, px; 0 if none."""
        return 0.0 if self.pinhole is None else self.pinhole.lens_remainder_px(self.grid.uv_px)

    @property
    def axes_mm_per_px(self) -> tuple[float, float]:
        """Scales at the middle of the grid along the image's x and y, mm/px.

        They differ if the camera is off-axis: the length in the grid's plane that one pixel covers is larger
        in the direction in which the plane is tilted. `mm_per_px` is a mean of both.
        """
        middle = self.grid.uv_px.mean(axis=0, keepdims=True)
        x_mm, y_mm = np.linalg.norm(self.jacobian(middle)[0], axis=0)
        return float(x_mm), float(y_mm)

    @property
    def _in_use(self) -> PlaneMap:
        if self.model == "pinhole" and self.pinhole is not None:
            return self.pinhole
        return self.bicubic


def as_it_is(grid: GridPoints, pinhole: Pinhole) -> tuple[GridPoints, Float]:
    """Return grid points where their rays meet the plane Z = 0, and the errors (n, 2, 5) that they share, mm.

    A point of a bowed grid is above or below this plane, and the camera sees it displaced.
    """
    places, slopes = deviated(grid.xy_mm, grid.half_mm, pinhole.deviations)
    foot, height_mm = pinhole.centre_mm[:2], pinhole.centre_mm[2]
    along = (places[:, :2] - foot) / (height_mm - places[:, 2:])
    met = places[:, :2] + along * places[:, 2:]
    by_deviation = slopes[:, :2] + along[:, :, None] * slopes[:, 2:]
    return replace(grid, xy_mm=met), by_deviation @ root(pinhole.deviation_covariance)


def _bicubic_cross_validation_px(grid: GridPoints) -> float:
    def prediction_errors(left_out: Mask) -> Float:
        kept = BicubicMap.fit(grid.uv_px[~left_out], grid.xy_mm[~left_out])
        at = grid.uv_px[left_out]
        off_mm = kept.map(at) - grid.xy_mm[left_out]
        return np.asarray(np.linalg.solve(kept.jacobian(at), off_mm[:, :, None])[:, :, 0], np.float64)

    try:
        return cross_validation_rms(grid, prediction_errors)
    except CalibrationError:
        return float("nan")
