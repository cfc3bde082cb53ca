"""Fit a pinhole camera to the grid points of one or several images.

The steps:

1. Find a homography for each image.
2. Compute start values of the focal length and of the camera's pose in each image from the homographies
   (Zhang, *A flexible new technique for camera calibration*, 2000).
3. Minimise the residuals of the grid points in the images, together with the deviations from values of the
   camera that the user knows. Each residual or deviation is divided by its standard deviation. The standard
   deviation of the grid points is estimated from their residuals.
"""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from dic.calibration.cross_validation import cross_validation_rms
from dic.calibration.grid_accuracy import FLAT, KnownGrid, deviated
from dic.calibration.pinhole.camera import Pinhole
from dic.calibration.pinhole.growth import expected_terms, remainder_degree
from dic.calibration.pinhole.lens import monomials
from dic.calibration.pinhole.model import GRID, CameraModel
from dic.calibration.pinhole.prior import KnownCamera, Prior
from dic.calibration.pinhole.start import homographies, start_focals, start_poses
from dic.errors import CalibrationError
from dic.targets.points import GridPoints
from dic.typing import Float, Indices, Mask

_FEWEST_POINTS = 10
_K2 = 4
"""Index of the distortion coefficient k2 among the parameters."""
_GROWTHS = 4
_MOST_STEPS = 100
"""Most steps of the iteration with a remainder of the lens."""
_FAR_OFF = 1.5
"""A principal point that is further from the middle than so many standard deviations was not expected."""
_LEAST_REMAINDER_PX = 0.003
"""A smaller remainder may come from the finder of the grid's points, and counts as noise of the points."""
_MOST_PRINCIPALS = 5
# Start value and lower limit of the noise of the grid points, px. With less noise the prior knowledge would
# have no weight.
_FIRST_NOISE_PX = 0.05
_FINEST_NOISE_PX = 1e-4


@dataclass(frozen=True)
class _Views:
    """Grid points of all images, and the known values of the camera."""

    xy_mm: list[Float]
    uv_px: list[Float]
    prior: Prior
    grid: KnownGrid
    half_mm: Float
    """Shape (2,). Half widths of the grid."""

    def without(self, left_out: Mask) -> "_Views":
        """Return the same views without the grid points of the first image that `left_out` (n,) marks."""
        xy, uv = self.xy_mm[0][~left_out], self.uv_px[0][~left_out]
        return replace(self, xy_mm=[xy, *self.xy_mm[1:]], uv_px=[uv, *self.uv_px[1:]])


@dataclass(frozen=True)
class _Solution:
    model: CameraModel
    parameters: Float
    covariance: Float
    noise_px: float
    lens_std: Float
    """Prior standard deviations of k2 and of the further terms; 0 for terms that are not fitted."""


def fit_pinhole(
    points: GridPoints,
    image_shape: tuple[int, ...],
    known: KnownCamera | None = None,
    k2: bool | None = None,
    grid: KnownGrid = FLAT,
) -> Pinhole:
    """Fit a camera to the grid points of one image, by least squares in the image.

    A single image determines the focal length only through perspective: well at 30° off-axis, poorly at 10°,
    and not at all at 0°. `Pinhole.covariance` gives the uncertainty of each parameter.

    `image_shape`: height and width of the image, px. `known`: known values of the camera, such as its focal
    length. `k2`: True to fit the distortion coefficient k2, False to leave it 0. By default cross-validation
    decides. If `k2` is given, no cross-validation is done.

    Raises `CalibrationError` if the points do not determine a camera, or if they contradict the known values
    of the camera.
    """
    return fit_pinholes([points], image_shape, known, k2, grid)[0]


def fit_pinholes(
    grids: Sequence[GridPoints],
    image_shape: tuple[int, ...],
    known: KnownCamera | None = None,
    k2: bool | None = None,
    grid: KnownGrid = FLAT,
) -> tuple[Pinhole, ...]:
    """Fit one camera to several images of the grid: one lens for all images, and one pose for each image.

    Images with the grid at different tilts determine the focal length even if the camera looks straight at
    the grid in the first image. The parameters and exceptions are the same as for `fit_pinhole`. A known
    distance of the camera from the grid is the distance in the first image.

    Result: one camera for each image, in the axes of the grid in that image.
    """
    prior = (known or KnownCamera()).prior(image_shape)
    views = _Views([g.xy_mm for g in grids], [g.uv_px for g in grids], prior, grid, grids[0].half_mm)
    _require_points(views)
    views, chosen = _settled(views, _first_solution(views), k2, 1)
    # A given value that is wrong would look like a lens with a large remainder.
    _require_agreement(views.prior.contradiction(chosen.parameters))
    if k2 is None:
        # A distortion that no remainder follows may keep the iteration from converging. Then all of it counts
        # as noise.
        with suppress(CalibrationError):
            grown = _settled(views, chosen, k2, remainder_degree(sum(map(len, views.xy_mm))))
            if _camera(grown[1], 0, float("nan")).lens_remainder_px(grids[0].uv_px) > _LEAST_REMAINDER_PX:
                views, chosen = grown
    missed_px = _cross_validation_px(views, chosen, grids[0]) if k2 is None else float("nan")
    return tuple(_camera(chosen, view, missed_px) for view in range(len(grids)))


def _settled(views: _Views, start: "_Solution", k2: bool | None, degree: int) -> tuple[_Views, "_Solution"]:
    """Return views and solution; the principal point may be where the images show it.

    A part of a sensor, or a mount made by hand, puts it far off. Where nothing of the camera is stated, the
    images count more than the expectation that it is near the middle. Where something is, the principal point
    does not make up for a wrong statement. `degree`: highest degree of the remainder of the lens.
    """
    found, known = _grown(views, start, k2, degree), views.prior.known
    stated = known.principal_px, known.principal_std_px, known.focal_px, known.distance_mm
    if any(value is not None for value in stated):
        return views, found
    for _ in range(_MOST_PRINCIPALS):
        prior = views.prior
        away_px = float(np.abs(found.parameters[1:3] - prior.principal_px).max())
        if away_px <= _FAR_OFF * prior.principal_std_px:
            break
        views = replace(views, prior=replace(prior, principal_std_px=1.2 * away_px))
        again = _solution(views, found.model, found.parameters, found.lens_std)
        found = _grown(views, again, k2, degree)
    return views, found


def _require_agreement(contradiction: str) -> None:
    if contradiction:
        raise CalibrationError(
            "pinhole camera",
            "fit lens and pose",
            "images that agree with what is known of the camera",
            contradiction,
            "correct --focal-px, --distance-mm or --principal-px, or give them a standard deviation, such as "
            "--focal-std-px 50",
        )


def _grown(views: _Views, start: "_Solution", k2: bool | None, degree: int) -> "_Solution":
    """Return the solution with the terms of the lens that the images ask for, or with or without k2."""
    if k2 is not None:
        return _solution(views, start.model, start.parameters, np.array([np.inf if k2 else 0.0]))
    solution = start
    for _ in range(_GROWTHS):
        every = _with_terms(solution, 1 + 2 * len(monomials(degree)))
        std = _LeastSquares(views, every.model, every.noise_px, every.lens_std).expected_lens(
            every.parameters
        )
        if np.array_equal(std, solution.lens_std):
            break
        solution = _solution(views, solution.model, _with_terms(every, len(std) - 1).parameters, std)
    return solution


def _with_terms(solution: "_Solution", count: int) -> "_Solution":
    """Return the solution with `count` parameters for further terms of the lens, which may be 0."""
    first, more, grid = np.split(solution.parameters, [solution.model.poses_end, -GRID])
    resized = np.zeros(count)
    resized[: len(more)] = more[:count]
    std = np.resize(np.append(solution.lens_std, np.zeros(count)), 1 + count)
    return replace(solution, parameters=np.concatenate([first, resized, grid]), lens_std=std)


def _first_solution(views: _Views) -> "_Solution":
    """Fit without k2; try start values of the focal length until the iteration converges."""
    problem = None
    flat = homographies(views.xy_mm, views.uv_px, views.prior.principal_px)
    for focal in start_focals(flat, views.prior):
        try:
            return _solution(views, *_start(views, flat, focal), np.zeros(1))
        except CalibrationError as error:
            problem = problem or error
    raise problem or _undetermined("no start value")


def _start(views: _Views, flat: list[Float], focal: float) -> tuple[CameraModel, Float]:
    """Return the camera model and start values of its parameters; distortion starts at 0."""
    rotations, poses = start_poses(flat, focal)
    half_px = float(max(np.ptp(uv, axis=0).max() for uv in views.uv_px)) / 2
    lens = [np.log(focal), *views.prior.principal_px, 0.0, 0.0, 0.0, 0.0]
    model = CameraModel(views.xy_mm, rotations, half_px, views.half_mm)
    return model, np.concatenate([lens, *poses, np.zeros(GRID)])


def _cross_validation_px(views: _Views, whole: "_Solution", first: GridPoints) -> float:
    def prediction_errors(left_out: Mask) -> Float:
        kept = views.without(left_out)
        model = replace(whole.model, xy_mm=kept.xy_mm)
        least = _LeastSquares(kept, model, whole.noise_px, whole.lens_std)
        fitted = replace(whole, model=model, parameters=least.solve(whole.parameters))
        camera = _camera(fitted, 0, float("nan"))
        places, _ = deviated(first.xy_mm[left_out], views.half_mm, camera.deviations)
        return first.uv_px[left_out] - camera.project(places)

    return cross_validation_rms(first, prediction_errors)


def _solution(views: _Views, model: CameraModel, start: Float, lens_std: Float) -> "_Solution":
    """Return the least-squares solution.

    The equations are solved twice, because their weights need the noise of the grid points. The first
    solution gives this noise.
    """
    parameters, noise_px = start, _FIRST_NOISE_PX
    for _ in range(2):
        least = _LeastSquares(views, model, noise_px, lens_std)
        parameters = least.solve(parameters)
        noise_px = least.scatter_px(parameters)
    least = _LeastSquares(views, model, noise_px, lens_std)
    return _Solution(model, parameters, least.covariance(parameters), noise_px, lens_std)


class _LeastSquares:
    """The least-squares equations of the grid points and of the known camera values, with derivatives.

    Each equation is a deviation divided by its standard deviation.
    """

    def __init__(self, views: _Views, model: CameraModel, noise_px: float, lens_std: Float) -> None:
        self._prior, self._model, self._noise_px = views.prior, model, noise_px
        self._grid = views.grid
        self._seen = np.concatenate([uv.ravel() for uv in views.uv_px])
        self._lens_std = lens_std

    def solve(self, start: Float) -> Float:
        """Return the parameters that minimise the sum of squared deviations (Levenberg–Marquardt)."""
        from scipy.optimize import least_squares

        free = self._free(start)
        last: list[tuple[Float, Float, Float]] = []

        def both(values: Float) -> tuple[Float, Float, Float]:
            # Keep the last result, because `least_squares` mostly calls `deviations` and `slopes` with the
            # same values.
            if not last or not np.array_equal(last[0][0], values):
                every = start.copy()
                every[free] = values
                last[:] = [(values.copy(), *self._equations(every))]
            return last[0]

        def deviations(values: Float) -> Float:
            return both(values)[1]

        def slopes(values: Float) -> Float:
            return both(values)[2][:, free]

        with np.errstate(all="ignore"):
            try:
                found = least_squares(
                    deviations,
                    start[free],
                    slopes,
                    method="lm",
                    x_scale="jac",
                    max_nfev=_MOST_STEPS if len(self._lens_std) > 2 else None,
                )
            except ValueError as error:
                raise _undetermined("points that do not fit a pinhole camera") from error
        if not (found.success and np.isfinite(found.x).all()):
            raise _undetermined("an iteration that did not converge")
        parameters = start.copy()
        parameters[free] = found.x
        return parameters

    def scatter_px(self, parameters: Float) -> float:
        """Return the standard deviation of the points' image coordinates, estimated from residuals, px."""
        residual = self._model.project(parameters)[0] - self._seen
        freedom = len(residual) - self._used(parameters)
        return max(float(np.sqrt(residual @ residual / freedom)), _FINEST_NOISE_PX)

    def covariance(self, parameters: Float) -> Float:
        """Return the covariance matrix of the parameters; rows and columns of absent terms are 0."""
        free = self._free(parameters)
        covariance = np.zeros((len(parameters), len(parameters)))
        covariance[np.ix_(free, free)] = _inverse_square(self._equations(parameters)[1][:, free])
        return covariance

    def expected_lens(self, parameters: Float) -> Float:
        """Return the prior standard deviations of further terms of the lens that the residuals ask for."""
        px, slopes = self._model.project(parameters)
        further = self._further(parameters)
        base = np.setdiff1d(np.flatnonzero(self._free(parameters)), further)
        left = self._seen - px + slopes[:, further] @ parameters[further]
        off, by_base = self._expectations(parameters)
        ordered = slopes[:, np.append(base, further)]
        expectations, scale_px = (-off, by_base[:, base]), self._model.scale_px
        return expected_terms(left, ordered, expectations, scale_px, _FINEST_NOISE_PX)

    def _further(self, parameters: Float) -> Indices:
        """Return the indices of k2, k3 and the remainder, as far as the parameters have them."""
        return np.append(_K2, np.arange(self._model.poses_end, len(parameters) - GRID))

    def _free(self, parameters: Float) -> Mask:
        free = np.ones(len(parameters), bool)
        free[self._further(parameters)] = self._lens_std > 0
        free[-GRID:] = self._grid.free
        return free

    def _used(self, parameters: Float) -> float:
        """Return how many degrees of freedom the points' noise has lost to the parameters."""
        slopes = self._equations(parameters)[1][:, self._free(parameters)]
        basis = np.linalg.qr(slopes / np.linalg.norm(slopes, axis=0))[0][: len(self._seen)]
        return float((basis**2).sum())

    def _equations(self, parameters: Float) -> tuple[Float, Float]:
        px, slopes = self._model.project(parameters)
        off, by_off = self._expectations(parameters)
        further = self._further(parameters)
        limited = (self._lens_std > 0) & np.isfinite(self._lens_std)
        weights = np.zeros((len(further), len(parameters)))
        weights[range(len(further)), further] = 1 / np.where(limited, self._lens_std, np.inf)
        weights = weights[limited]
        deviations = np.concatenate([(px - self._seen) / self._noise_px, off, weights @ parameters])
        return deviations, np.vstack([slopes / self._noise_px, by_off, weights])

    def _expectations(self, parameters: Float) -> tuple[Float, Float]:
        """Return the deviations from what is known of camera and grid, and their derivatives."""
        off, by_off = self._prior.equations(parameters)
        weights = self._grid.weights
        off_grid = weights @ (parameters[-GRID:] - self._grid.mean)
        by_grid = np.pad(weights, ((0, 0), (len(parameters) - GRID, 0)))
        return np.append(off, off_grid), np.vstack([by_off, by_grid])


def _inverse_square(slopes: Float) -> Float:
    """Return (SᵀS)⁻¹ of the derivatives S, by singular values, because forming SᵀS would lose digits."""
    size = np.linalg.norm(slopes, axis=0)
    _, singular, directions = np.linalg.svd(slopes / size, full_matrices=False)
    if not singular[-1] > 1e-13 * singular[0]:
        raise _undetermined("points that leave a parameter undetermined")
    root = directions.T / singular / size[:, None]
    return np.asarray(root @ root.T)


def _camera(solution: "_Solution", view: int, missed_px: float) -> Pinhole:
    rotation, centre, values, slopes = solution.model.camera(solution.parameters, view)
    if not (np.isfinite(values).all() and centre[2] > 0):
        raise _undetermined("a camera behind the grid")
    of_grid = solution.covariance[-GRID:, -GRID:]
    return Pinhole(
        deviations=solution.parameters[-GRID:],
        deviation_covariance=of_grid,
        by_deviations=slopes @ solution.covariance[:, -GRID:] @ np.linalg.pinv(of_grid, hermitian=True),
        focal_px=float(values[0]),
        principal_px=values[1:3],
        distortion=np.append(values[3:7], values[13:]),
        rotation=rotation,
        centre_mm=centre,
        covariance=slopes @ solution.covariance @ slopes.T,
        noise_px=solution.noise_px,
        cross_validation_px=missed_px,
    )


def _require_points(views: _Views) -> None:
    for xy, uv in zip(views.xy_mm, views.uv_px, strict=True):
        if len(xy) < _FEWEST_POINTS:
            raise _undetermined(f"{len(xy)} points")
        for points in (xy, uv):
            if not np.isfinite(points).all() or np.linalg.matrix_rank(points - points.mean(axis=0), 1e-6) < 2:
                raise _undetermined("points on one line")


def _undetermined(got: str) -> CalibrationError:
    return CalibrationError(
        "pinhole camera",
        "fit lens and pose",
        f"at least {_FEWEST_POINTS} points in every image, as a pinhole camera shows a plane grid",
        got,
        "use a grid with at least four lines in view in each direction, or leave this image out",
    )
