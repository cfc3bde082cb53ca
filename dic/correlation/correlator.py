"""Correlate deformed images with their reference: fields of displacements in pixels."""

import numpy as np

from dic.correlation import kernel
from dic.correlation.consistency import consistent_field
from dic.correlation.field import Field
from dic.correlation.initial_guess import checked_homography
from dic.correlation.prepared_reference import PreparedReference
from dic.correlation.seeds import FEWEST_SEEDS, SeedFinder, Seeds, scattered
from dic.correlation.settings import CorrelationSettings
from dic.correlation.solver import Solver
from dic.correlation.status import Status
from dic.correlation.turned_image import TurnableImage
from dic.errors import CorrelationError, require_kind
from dic.image.given import checked_region, grey_image
from dic.image.point_grid import place_points
from dic.image.spline import spline_image
from dic.image.texture import textured
from dic.image.threads import processors
from dic.typing import Float, Grey, ImageLike, Mask, PathLike

_LOST_SHARE = 0.05
"""Share of the points that must have failed before new seeds are searched among them."""


class Correlator:
    """Correlates deformed images with one reference, which is prepared once.

    Parameters
    ----------
    reference : ndarray, shape (height, width), or path
        Grey levels, or an image file.
    region : ndarray of bool, shape (height, width), or path, optional
        Region of interest, where points may lie. Without one, points are put wherever the reference has
        texture.
    settings : CorrelationSettings, optional
    clip : bool
        Whether subsets use only pixels of the region, as they must where the surface ends at its edge.
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
        self.settings = settings = settings or CorrelationSettings()
        grey = _checked_reference(reference, settings.subset_px)
        threads = threads or processors()
        spline = spline_image(grey, settings.order, threads)
        slopes = spline.gradient(threads)
        usable = np.ones(grey.shape, np.bool_)
        if region is None:
            self.region = textured(*slopes, settings.subset_px, threads)
        else:
            self.region = checked_region(region, grey.shape)
            usable = self.region if clip else usable
        grid = place_points(self.region, usable, settings.subset_px, settings.step_px)
        mean = float(grey.mean())
        image = kernel.lay_reference(spline, slopes, usable, mean, threads)
        self._reference = PreparedReference(image, mean, usable, grid, settings, threads)
        self._seed_finder = SeedFinder(self._reference, grey)

    def correlate(
        self, deformed: ImageLike, *, previous: Field | None = None, hint: Float | None = None
    ) -> Field:
        """Return the displacement field from the reference to `deformed`.

        Parameters
        ----------
        deformed : ndarray, of the reference's shape, or path
        previous : Field, optional
            The field of the step before, a good start if little has happened since.
        hint : ndarray, shape (3, 3), optional
            Expected homography from the reference to the deformed image, for instance from the stage's angle:
            see `dic.rigid_motion`.

        Raises
        ------
        CorrelationError
            If the image cannot be used, or does not show the reference's pattern.
        """
        require_kind("previous", previous, Field | None, "give the field of the image before")
        hint = None if hint is None else checked_homography(hint)
        image = TurnableImage(self._reference, self._checked_deformed(deformed))
        seeds = self._first_seeds(image, previous, hint)
        solver = image.solver(seeds.quarters)
        solution = kernel.Solution.empty(self._reference.grid.active.shape, self.settings.parameters)
        self._solve_from_seeds(solver, solution, seeds)
        self._reject_inconsistent(solver, solution)
        if self._solve_lost_points(image, seeds.quarters, solution, previous):
            self._reject_inconsistent(solver, solution)
        failed = ~solution.converged
        solution.warps[failed] = solution.std[failed] = np.nan
        solution = image.turned_back(solution, seeds.quarters)
        grid = self._reference.grid
        return Field(
            grid.x, grid.y, solution.warps, solution.std, solution.zncc, solution.iterations,
            solution.status, grid.active, seeds.start, self.settings,
        )  # fmt: skip

    def _checked_deformed(self, deformed: ImageLike) -> Grey:
        """Return the image as float32, or raise `CorrelationError` if its size is not the reference's."""
        grey, shape = grey_image(deformed, "deformed image"), self._reference.usable.shape
        if grey.shape != shape:
            raise CorrelationError(
                "deformed image",
                "compare with the reference",
                f"{shape[1]} x {shape[0]} px",
                f"{grey.shape[1]} x {grey.shape[0]} px",
                f"use images that one camera took with one readout region, all {shape[1]} x {shape[0]} px",
            )
        return grey

    def _first_seeds(self, image: TurnableImage, previous: Field | None, hint: Float | None) -> Seeds:
        """Return seeds spread over the whole grid."""
        indices = scattered(self._reference.grid.active)
        before = None if previous is None else previous.warps
        seeds = self._seed_finder.find(image, indices, previous=before, hint=hint)
        fewest = min(FEWEST_SEEDS, len(indices))
        if len(seeds.indices) < fewest:
            subset_px = self.settings.subset_px
            raise CorrelationError(
                "deformed image",
                "find the reference's pattern",
                f"at least {fewest} of {len(indices)} subsets of {subset_px} px"
                f" with ZNCC above {self.settings.min_zncc:g} that predict one another",
                f"{len(seeds.indices)}",
                "check that both images show the same textured surface, or give a larger subset, such as"
                f" {subset_px + 20} px",
            )
        return seeds

    def _solve_from_seeds(self, solver: Solver, solution: kernel.Solution, seeds: Seeds) -> None:
        """Solve every point that propagation reaches from the seeds, and islands from their nearest point."""
        grid = self._reference.grid
        whole = grid.active & ~grid.cut
        indices, solved, in_bands = seeds.indices, seeds.solution, True
        while True:
            solution.put((indices[:, 0], indices[:, 1]), solved)
            solver.propagate(solution, whole & ~solution.converged, in_bands=in_bands)
            solver.solve_beside_cracks(solution)
            indices = np.argwhere(grid.active & (solution.status == Status.NOT_REACHED))
            if not indices.size:
                return
            solved = solver.solve(indices, solver.guess_from_nearest(solution, indices))
            in_bands = False

    def _solve_lost_points(
        self, image: TurnableImage, quarters: int, solution: kernel.Solution, previous: Field | None
    ) -> bool:
        """Search new seeds among lost points, which may lie on a body with a motion of its own.

        Only points that the step before had are searched, so that points lost for good do not cost a search
        in every image of a series. Returns whether there were seeds.
        """
        grid = self._reference.grid
        lost = grid.active & ~solution.converged & (solution.status != Status.OUT_OF_VIEW)
        if previous is not None:
            lost &= previous.converged
        if lost.sum() < max(FEWEST_SEEDS, _LOST_SHARE * grid.active.sum()):
            return False
        seeds = self._seed_finder.find(image, scattered(lost), quarters=quarters)
        if len(seeds.indices) < FEWEST_SEEDS:
            return False
        self._solve_from_seeds(image.solver(quarters), solution, seeds)
        return True

    def _reject_inconsistent(self, solver: Solver, solution: kernel.Solution) -> None:
        """Reject the points that no neighbour predicts, after one more try from consistent neighbours."""
        grid = self._reference.grid
        for last_try in (False, True):
            converged = grid.active & solution.converged
            inconsistent = converged & ~consistent_field(grid.x, grid.y, solution.warps, converged)
            if not inconsistent.any():
                return
            solution.status[inconsistent] = Status.INCONSISTENT
            if not last_try:
                solver.propagate(solution, inconsistent & ~grid.cut, in_bands=False)
                solver.solve_beside_cracks(solution)


def _checked_reference(reference: ImageLike, subset_px: int) -> Grey:
    """Return the image as float32, or raise `CorrelationError` if it holds no subset."""
    grey = grey_image(reference, "reference image")
    if min(grey.shape) < subset_px:
        raise CorrelationError(
            "reference image",
            "read",
            f"an image that holds a subset of {subset_px} px",
            f"{grey.shape[1]} x {grey.shape[0]} px",
            "use a larger image, or give a smaller subset (odd, at least 7 px)",
        )
    return grey
