"""The calibration function of Helm and Deaner: grid coordinates X and Y as bicubic polynomials of x and y."""

from dataclasses import dataclass, field

import numpy as np

from dic.errors import CalibrationError
from dic.typing import Float


@dataclass(frozen=True)
class BicubicMap:
    """The map from image px to grid mm: ``X = Σ a_ij ξ^i η^j``, ``Y = Σ b_ij ξ^i η^j``, i, j = 0 … 3.

    ξ and η are the pixel coordinates x and y, centred and scaled to ±1. Without centring and scaling, the
    least-squares problem would be badly conditioned. Scaling does not change the fitted map.

    Attributes
    ----------
    coefficients : ndarray, shape (4, 4, 2)
        The coefficients a_ij and b_ij in mm. The three indices of the array are i (power of ξ), j (power of
        η), and X or Y.
    centre_px : ndarray, shape (2,)
        Image point with ξ = η = 0, px.
    scale_px : float
        Number of pixels per unit of ξ and of η.
    coefficient_errors : ndarray, shape (16, 2, q)
        A matrix E, in mm, that gives the errors of the coefficients as E·e. The q elements of the vector e
        are independent random numbers with variance 1. If the errors of the coefficients are unknown, the
        array is empty (q = 0).

    References
    ----------
    Helm and Deaner, *Off-Axis Two-Dimensional Digital Image Correlation*, equations 1 and 2.
    """

    coefficients: Float
    centre_px: Float
    scale_px: float
    coefficient_errors: Float = field(default_factory=lambda: np.zeros((16, 2, 0)))

    def __repr__(self) -> str:
        x, y = self.centre_px
        return f"BicubicMap(around ({x:.1f}, {y:.1f}) px ± {self.scale_px:.1f} px)"

    @classmethod
    def fit(cls, points_px: Float, points_mm: Float, shared_mm: Float | None = None) -> "BicubicMap":
        """Fit the bicubic surfaces for X and for Y by least squares.

        Parameters
        ----------
        points_px, points_mm : ndarray, shape (n, 2)
            Image coordinates and grid coordinates of the same points.
        shared_mm : ndarray, shape (n, 2, k), optional
            Errors of the grid coordinates by k independent sources with variance 1, which all points share.

        Raises
        ------
        CalibrationError
            If there are fewer than 16 points, or if they lie on fewer than four lines in one direction.
        """
        if len(points_px) < 16:
            raise _undetermined(f"{len(points_px)} points")
        centre_px = (points_px.min(axis=0) + points_px.max(axis=0)) / 2
        scale_px = float(np.abs(points_px - centre_px).max())
        design = _monomials((points_px - centre_px) / scale_px)
        coefficients, _, rank, _ = np.linalg.lstsq(design, points_mm, rcond=1e-10)
        if rank < 16:
            raise _undetermined("points on fewer than four lines in one direction")
        fitted = cls(coefficients.reshape(4, 4, 2).astype(np.float64), centre_px, scale_px)
        errors = fitted._coefficient_errors(design, points_px, points_mm)
        if shared_mm is not None:
            shared = np.linalg.lstsq(design, shared_mm.reshape(len(design), -1), rcond=1e-10)[0]
            errors = np.concatenate([errors, shared.reshape(16, 2, -1)], axis=2)
        return cls(fitted.coefficients, centre_px, scale_px, errors)

    def map(self, px: Float) -> Float:
        """Return the grid coordinates X and Y of image points.

        Parameters
        ----------
        px : ndarray, shape (n, 2)

        Returns
        -------
        ndarray, shape (n, 2)
            X and Y in mm, or NaN for points whose image coordinates are NaN.
        """
        result: Float = _monomials(self._normalised(px)) @ self.coefficients.reshape(16, 2)
        return result

    def jacobian(self, px: Float) -> Float:
        """Return the Jacobian ``∂(X, Y)/∂(x, y)`` in mm/px at image points (n, 2), shape (n, 2, 2)."""
        powers = _powers(self._normalised(px))
        slopes = np.zeros_like(powers)
        slopes[:, :, 1:] = powers[:, :, :3] * np.arange(1, 4) / self.scale_px
        by_x = np.einsum("ni,nj,ijc->nc", slopes[:, 0], powers[:, 1], self.coefficients)
        by_y = np.einsum("ni,nj,ijc->nc", powers[:, 0], slopes[:, 1], self.coefficients)
        return np.stack([by_x, by_y], axis=-1)

    def error_factors(self, px: Float) -> Float:
        """Return a matrix F for each image point (n, 2); F Fᵀ is the error covariance of the mapped point.

        The result has the shape (n, 2, q) and the unit mm. The matrix F is computed from the residuals of the
        fitted map, so a systematic misfit of the map also increases F.
        """
        design = _monomials(self._normalised(px))
        return np.asarray(np.einsum("nk,kcq->ncq", design, self.coefficient_errors))

    def _coefficient_errors(self, design: Float, points_px: Float, points_mm: Float) -> Float:
        """Return `coefficient_errors` for image points whose errors are as large as the residuals."""
        jacobian = self.jacobian(points_px)
        residual_mm = self.map(points_px) - points_mm
        residual_px = np.linalg.solve(jacobian, residual_mm[:, :, None])
        freedom = residual_px.size - 32
        noise_px = np.sqrt((residual_px**2).sum() / freedom) if freedom else np.nan
        # With design = Q·R, errors e of the points in mm change the coefficients by R⁻¹·Qᵀ·e.
        q, r = np.linalg.qr(design)
        along = np.einsum("nka,nla->nkl", jacobian, jacobian)
        covariance = np.einsum("nk,nl,ncd->kcld", q, q, along, optimize=True).reshape(32, 32)
        root = np.linalg.cholesky(covariance).reshape(16, -1)
        return np.asarray(noise_px * np.linalg.solve(r, root).reshape(16, 2, -1))

    def _normalised(self, px: Float) -> Float:
        return (np.asarray(px, np.float64).reshape(-1, 2) - self.centre_px) / self.scale_px


def _powers(points: Float) -> Float:
    square = points * points
    return np.stack([np.ones_like(points), points, square, square * points], axis=-1)


def _monomials(points: Float) -> Float:
    powers = _powers(points)
    return (powers[:, 0, :, None] * powers[:, 1, None, :]).reshape(-1, 16)


def _undetermined(got: str) -> CalibrationError:
    return CalibrationError(
        "bicubic map",
        "fit sixteen parameters",
        "at least 4 × 4 grid points in general position",
        got,
        "use a grid with at least four lines in view in each direction",
    )
