"""A camera's calibration: image px to grid mm, valid within the grid it was made with."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from dic.calibration.bicubic import BicubicMap
from dic.calibration.cross_validation import missed_by
from dic.calibration.pinhole.camera import Pinhole
from dic.calibration.pinhole.fit import fit_pinholes
from dic.calibration.pinhole.prior import Known
from dic.calibration.residuals import PlaneMap, Residuals
from dic.errors import CalibrationError
from dic.targets.points import GridPoints

Float = NDArray[np.float64]
Model = Literal["bicubic", "pinhole"]

_CLEARLY_BETTER = 0.95
_NEGLIGIBLE_PX = 1e-4


@dataclass(frozen=True)
class Calibration:
    """Two calibrations of one camera, of which `model` says the one that is used.

    Attributes
    ----------
    bicubic : BicubicMap
        The paper's: image px to grid mm.
    grid : GridPoints
        The intersections it was fitted to.
    image_shape : tuple of int
        Height and width of the grid image, px.
    source : str
        The grid image's file, or the camera and run it came from.
    pinhole : Pinhole or None
        The camera as geometry describes it.
    pinhole_problem : str
        Why there is no `pinhole`.
    bicubic_cross_validation_px : float
        Root mean square distance by which the bicubic map misses points left out of its fit; NaN if the grid
        is too small to leave any out. The pinhole's is its own `cross_validation_px`.
    images : int
        How many images of the grid there were. The first defines the plane; the others serve the pinhole.
    model : str
        "bicubic" or "pinhole": what `map`, `jacobian`, residuals and scale are those of.
    """

    bicubic: BicubicMap
    grid: GridPoints
    image_shape: tuple[int, int]
    source: str = ""
    pinhole: Pinhole | None = None
    pinhole_problem: str = "it was not fitted"
    bicubic_cross_validation_px: float = float("nan")
    images: int = 1
    model: Model = "bicubic"

    @classmethod
    def fit(
        cls,
        grid: GridPoints | Sequence[GridPoints],
        image_shape: tuple[int, ...],
        source: str = "",
        *,
        known: Known | None = None,
    ) -> "Calibration":
        """Fit the bicubic map and the pinhole model to the grid points of one image, or of several.

        Parameters
        ----------
        grid : GridPoints or sequence of GridPoints
            The first image's define the plane; more images, with the grid tilted, help the pinhole model.
        image_shape : tuple of int
        source : str
        known : Known, optional
            What is known of the camera, for the pinhole model.

        Raises
        ------
        CalibrationError
            If the points do not determine the bicubic map.
        """
        grids = [grid] if isinstance(grid, GridPoints) else list(grid)
        first = grids[0]
        bicubic = BicubicMap.fit(first.uv_px, first.xy_mm)
        pinhole, problem = None, ""
        try:
            pinhole = fit_pinholes(grids, image_shape, known)[0]
        except CalibrationError as error:
            problem = f"{error.step}: expected {error.expected}, got {error.got}"
        return cls(
            bicubic,
            first,
            (image_shape[0], image_shape[1]),
            source,
            pinhole,
            problem,
            _bicubic_cross_validation_px(first),
            len(grids),
        )

    def using(self, model: Model) -> "Calibration":
        """Return the same calibration with another model in use.

        Raises
        ------
        CalibrationError
            If there is no such model.
        """
        if model == "pinhole" and self.pinhole is None:
            raise CalibrationError(
                self.source or "calibration",
                "use the pinhole model",
                "a camera that could be fitted",
                self.pinhole_problem,
                "use the bicubic map, or calibrate anew",
            )
        return replace(self, model=model)

    @property
    def recommended(self) -> Model:
        """The model that predicts left-out points better; the paper's where the difference is not clear."""
        if self.pinhole is None:
            return "bicubic"
        # what could not be tested is worse than anything that was
        bicubic_px = np.nan_to_num(self.bicubic_cross_validation_px, nan=np.inf)
        limit_px = _CLEARLY_BETTER * bicubic_px - _NEGLIGIBLE_PX
        return "pinhole" if self.pinhole.cross_validation_px < limit_px else "bicubic"

    @property
    def recommendation(self) -> str:
        """The recommended model and the reason, in one sentence."""
        if self.pinhole is None:
            return f"bicubic: there is no pinhole model ({self.pinhole_problem})"
        bicubic, pinhole = self.bicubic_cross_validation_px, self.pinhole.cross_validation_px
        if np.isnan(bicubic):
            return f"pinhole: predicts left-out points to {pinhole:.4f} px; bicubic needs more lines to tell"
        if self.recommended == "pinhole":
            return f"pinhole: predicts left-out points to {pinhole:.4f} px, bicubic to {bicubic:.4f} px"
        figures = f"bicubic: predicts left-out points to {bicubic:.4f} px, pinhole to {pinhole:.4f} px"
        clear = bicubic < _CLEARLY_BETTER * pinhole - _NEGLIGIBLE_PX
        return figures if clear else f"{figures}: without a clear difference it is the paper's"

    def map(self, px: Float) -> Float:
        """Return grid coordinates (n, 2) in mm of image points (n, 2) in px; NaN stays NaN.

        The map holds only where `inside` is true.
        """
        return self._in_use.map(px)

    def jacobian(self, px: Float) -> NDArray[np.float64]:
        """Return ``∂(X, Y)/∂(x, y)`` in mm/px at image points (n, 2), as an array (n, 2, 2)."""
        return self._in_use.jacobian(px)

    def error_factors(self, px: Float) -> NDArray[np.float64]:
        """Return F, shape (n, 2, q), mm: the map's errors at image points (n, 2) have the covariance F Fᵀ.

        They come from the scatter of the grid points in the image. The same column belongs to the same error
        at all points, so that errors of differences are those of the differences of F.
        """
        return self._in_use.error_factors(px)

    def inside(self, px: Float) -> NDArray[np.bool_]:
        """Tell which image points (n, 2) lie within the calibrated area; NaN is outside.

        The area is the polygon of the outermost grid points, whichever model is in use. Outside it the
        bicubic map "quickly deviates from the desired values" (Helm and Deaner), and no point tests the
        pinhole model, so such points are flagged wherever they occur.
        """
        points = np.asarray(px, np.float64).reshape(-1, 2)
        outline = self.outline_px
        inside = np.zeros(len(points), bool)
        for start, end in zip(outline, np.roll(outline, -1, axis=0), strict=True):
            if start[1] == end[1]:
                continue
            spans = (start[1] > points[:, 1]) != (end[1] > points[:, 1])
            slope = (end[0] - start[0]) / (end[1] - start[1])
            inside ^= spans & (points[:, 0] < start[0] + slope * (points[:, 1] - start[1]))
        return inside

    @cached_property
    def outline_px(self) -> Float:
        """The calibrated area's corners in the image, in order, shape (m, 2), px."""
        return self.grid.outline_px()

    @cached_property
    def residuals(self) -> dict[Model, Residuals]:
        """What each model leaves of the grid points."""
        residuals: dict[Model, Residuals] = {"bicubic": Residuals.of(self.bicubic, self.grid)}
        if self.pinhole is not None:
            residuals["pinhole"] = Residuals.of(self.pinhole, self.grid)
        return residuals

    @property
    def residual_mm(self) -> Float:
        """Mapped minus true position of every grid point by the model in use, shape (n, 2), mm."""
        return self.residuals[self.model].mm

    @property
    def residual_px(self) -> Float:
        """The same residual as it appears in the image, shape (n, 2), px."""
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
        """Scale at the middle of the grid: the square root of the area that one pixel sees."""
        middle = self.grid.uv_px.mean(axis=0, keepdims=True)
        return float(np.sqrt(abs(np.linalg.det(self.jacobian(middle)[0]))))

    @property
    def _in_use(self) -> PlaneMap:
        if self.model == "pinhole" and self.pinhole is not None:
            return self.pinhole
        return self.bicubic


def _bicubic_cross_validation_px(grid: GridPoints) -> float:
    def misses(left_out: NDArray[np.bool_]) -> Float:
        kept = BicubicMap.fit(grid.uv_px[~left_out], grid.xy_mm[~left_out])
        at = grid.uv_px[left_out]
        off_mm = kept.map(at) - grid.xy_mm[left_out]
        return np.asarray(np.linalg.solve(kept.jacobian(at), off_mm[:, :, None])[:, :, 0], np.float64)

    try:
        return missed_by(grid, misses)
    except CalibrationError:
        return float("nan")
