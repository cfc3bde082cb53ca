"""Correlate deformed images with their reference: fields of displacements in pixels."""

from typing import NamedTuple

import numpy as np

from dic.correlation import kernel
from dic.correlation.consistency import consistent_field, consistent_seeds
from dic.correlation.features import FeatureFinder
from dic.correlation.field import Field
from dic.correlation.initial_guess import guesses
from dic.correlation.quarter_turn import quarters_of
from dic.correlation.settings import CorrelationSettings
from dic.correlation.solver import PreparedReference, Solution, Solver
from dic.correlation.status import Status
from dic.correlation.turned_image import TurnableImage
from dic.errors import CorrelationError, require_kind
from dic.image.given import checked_region, grey_image
from dic.image.region import place_points, textured
from dic.image.spline import spline_image
from dic.image.threads import processors
from dic.typing import Float, Grey, ImageLike, Indices, Mask, PathLike

SEEDS = 48
"""Points tried first; propagation starts from those that converge."""

_FEWEST_SEEDS = 3
_ENOUGH_SEEDS = 0.3
"""Share of the seeds in view that must converge before a way of guessing is believed."""

_LOST = 0.05
"""Share of the points that must have failed before they are looked for anew."""


class _Seeds(NamedTuple):
    """Points to start from.

    Attributes
    ----------
    start : str
        Name of the guess that led to them.
    quarters : int
        Quarters by which the deformed image was turned for them.
    indices : ndarray of int, shape (n, 2)
        Row and column on the grid.
    solution : Solution
        In the turned image.
    """

    start: str
    quarters: int
    indices: Indices
    solution: Solution


class Correlator:
    """Correlates a series with one reference, whose preparation is done once.

    Parameters
    ----------
    reference : ndarray, shape (height, width), or path
        Grey levels, or an image file.
    region : ndarray of bool, shape (height, width), or path, optional
        Region of interest, where points may lie. Without one, points are put wherever the reference has
        texture.
    settings : CorrelationSettings
    clip : bool
        Whether subsets are clipped at the region's edge, as they must be where the surface ends there.
    threads : int
        How many to work with; 0 for as many as there are processors.

    Attributes
    ----------
    region : ndarray of bool, shape (height, width)
        Where points may lie, as given or as found.

    Raises
    ------
    CorrelationError
        If the image cannot be used or the region holds no point.
    """

    def __init__(
        self,
        reference: ImageLike,
        region: Mask | PathLike | None = None,
        settings: CorrelationSettings | None = None,
        *,
        clip: bool = True,
        threads: int = 0,
    ) -> None:
        require_kind("settings", settings, CorrelationSettings | None, "give dic.CorrelationSettings()")
        self.settings = settings or CorrelationSettings()
        self._grey = _checked_image(reference, "reference image", self.settings.subset_px)
        self._threads = threads or processors()
        spline = spline_image(self._grey, self.settings.order, self._threads)
        slopes = spline.gradient(self._threads)
        usable = np.ones(self._grey.shape, np.bool_)
        if region is None:
            centres = textured(*slopes, self.settings.subset_px, self._threads)
        else:
            centres = checked_region(region, self._grey.shape)
            usable = centres if clip else usable
        self.region = centres
        grid = place_points(centres, usable, self.settings.subset_px, self.settings.step_px)
        self._mean = float(self._grey.mean())
        self._features = FeatureFinder(self._grey, usable)
        self._reference = PreparedReference(
            kernel.lay_reference(spline, slopes, usable, self._mean, self._threads),
            usable,
            grid,
            self.settings,
            self._threads,
        )

    def correlate(
        self, deformed: ImageLike, *, previous: Field | None = None, hint: Float | None = None
    ) -> Field:
        """Return the displacement field from the reference to `deformed`.

        Parameters
        ----------
        deformed : ndarray, of the reference's shape, or path
        previous : Field, optional
            The field of the step before, a good start when little happened since.
        hint : ndarray, shape (3, 3), optional
            Expected homography from the reference to the deformed image, from the stage's angle for instance:
            see `dic.rigid_motion`.

        Raises
        ------
        CorrelationError
            If the image cannot be used, or shows nothing of the reference's pattern.
        """
        deformed = grey_image(deformed, "deformed image")
        if deformed.shape != self._grey.shape:
            raise CorrelationError(
                "deformed image",
                "compare with the reference",
                f"{self._grey.shape[1]} x {self._grey.shape[0]} px",
                " x ".join(str(n) for n in deformed.shape[::-1]) + " px",
                "use images of one camera at one format",
            )
        image = TurnableImage(self._reference, deformed, self._mean)
        seeds = self._first_guess(image, previous, hint)
        solver = image.solver(seeds.quarters)
        solution = Solution.empty(self._reference.grid.active.shape, self.settings.parameters)
        self._fill(solver, solution, seeds.indices, seeds.solution)
        self._doubt(solver, solution)
        if self._look_anew(image, seeds.quarters, solution, previous):
            self._doubt(solver, solution)
        failed = ~solution.converged
        solution.warps[failed] = solution.std[failed] = np.nan
        solution = image.turned_back(solution, seeds.quarters)
        grid = self._reference.grid
        return Field(
            grid.x, grid.y, solution.warps, solution.std, solution.zncc, solution.iterations,
            solution.status, grid.active, seeds.start, self.settings,
        )  # fmt: skip

    def _first_guess(self, image: TurnableImage, previous: Field | None, hint: Float | None) -> _Seeds:
        """Return the seeds of the guess that worked."""
        indices = _scattered(self._reference.grid.active)
        best = self._seeds(image, indices, previous, hint)
        fewest = min(_FEWEST_SEEDS, len(indices))
        if len(best.indices) < fewest:
            raise CorrelationError(
                "deformed image",
                "find the reference's pattern",
                f"at least {fewest} of {len(indices)} subsets of {self.settings.subset_px} px"
                f" with ZNCC above {self.settings.min_zncc:g}",
                f"{len(best.indices)} that agree",
                "check that both images show the same textured surface, or choose a larger subset",
            )
        return best

    def _seeds(
        self,
        image: TurnableImage,
        indices: Indices,
        previous: Field | None = None,
        hint: Float | None = None,
        quarters: int | None = None,
    ) -> _Seeds:
        """Return the seeds of the guess that most points at `indices` confirm.

        The image is turned as each guess says, or by so many `quarters`.
        """
        points = self._reference.grid.points_at(indices)
        before = None if previous is None else previous.warps[indices[:, 0], indices[:, 1], :6]
        half_px = max(self.settings.radius_px, 15)
        best = _Seeds("", 0, indices[:0], Solution.empty((0,), self.settings.parameters))
        for name, guess in guesses(
            self._grey, image.grey, self._features, points, half_px,
            previous=before, hint=hint, threads=self._threads,
        ):  # fmt: skip
            turn = quarters_of(guess) if quarters is None else quarters
            solved = image.solver(turn).solve(indices, image.turned(guess, points, turn))
            good = solved.converged
            good[good] = consistent_seeds(points[good], solved.warps[good])
            if good.sum() > len(best.indices):
                best = _Seeds(name, turn, indices[good], solved.part(np.flatnonzero(good)))
            in_view = np.count_nonzero(solved.status != Status.OUT_OF_VIEW)
            if len(best.indices) >= max(min(_FEWEST_SEEDS, len(points)), _ENOUGH_SEEDS * in_view):
                break
        return best

    def _fill(self, solver: Solver, solution: Solution, seeds: Indices, solved: Solution) -> None:
        """Solve every point that can be reached from the seeds, and islands from what is nearest to them."""
        grid = self._reference.grid
        whole = grid.active & ~grid.cut
        first = True
        while True:
            solution.put((seeds[:, 0], seeds[:, 1]), solved)
            solver.propagate(solution, whole & ~solution.converged, side_by_side=first)
            solver.solve_beside_cracks(solution)
            seeds = np.argwhere(grid.active & (solution.status == Status.NOT_REACHED))
            if not seeds.size:
                return
            solved = solver.solve(seeds, solver.from_nearest(solution, seeds))
            first = False

    def _look_anew(
        self, image: TurnableImage, quarters: int, solution: Solution, previous: Field | None
    ) -> bool:
        """Look for many lost points as if nothing were known: they may lie on a body that moves on its own.

        Points that had been lost before are left alone, or every image of a series were searched for them.
        """
        grid = self._reference.grid
        lost = grid.active & ~solution.converged & (solution.status != Status.OUT_OF_VIEW)
        if previous is not None:
            lost &= previous.converged
        if lost.sum() < max(_FEWEST_SEEDS, _LOST * grid.active.sum()):
            return False
        seeds = self._seeds(image, _scattered(lost), quarters=quarters)
        if len(seeds.indices) < _FEWEST_SEEDS:
            return False
        self._fill(image.solver(quarters), solution, seeds.indices, seeds.solution)
        return True

    def _doubt(self, solver: Solver, solution: Solution) -> None:
        """Take back the points that no neighbour predicts, after one more try from those that agree."""
        grid = self._reference.grid
        for last in (False, True):
            converged = grid.active & solution.converged
            alone = converged & ~consistent_field(grid.x, grid.y, solution.warps, converged)
            if not alone.any():
                return
            solution.status[alone] = Status.INCONSISTENT
            if not last:
                solver.propagate(solution, alone & ~grid.cut, side_by_side=False)
                solver.solve_beside_cracks(solution)


def _scattered(points: Mask) -> Indices:
    """Return up to about `SEEDS` indices (row, column) spread over the true ones of a grid."""
    rows, columns = np.nonzero(points)
    stride = max(1, round(np.sqrt(rows.size / SEEDS)))
    while True:
        chosen = (rows % stride == stride // 2) & (columns % stride == stride // 2)
        if chosen.sum() >= min(SEEDS // 2, rows.size) or stride == 1:
            return np.stack([rows[chosen], columns[chosen]], axis=1)
        stride -= 1


def _checked_image(image: ImageLike, name: str, subset_px: int) -> Grey:
    """Return the image as float32, or say why it cannot be used."""
    grey = grey_image(image, name)
    if min(grey.shape) < subset_px:
        raise CorrelationError(
            name,
            "read",
            f"an image wider and higher than a subset of {subset_px} px",
            " x ".join(str(n) for n in grey.shape[::-1]) + " px",
            "use a larger image or a smaller subset",
        )
    return grey
