"""Correlate deformed images with their reference, and return fields of displacements in pixels."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from dic.correlation import kernel
from dic.correlation.consistency import consistent_field
from dic.correlation.earlier_field import EarlierField
from dic.correlation.field import Field
from dic.correlation.initial_guess import checked_homography, homography_warps
from dic.correlation.laid_rows import LaidReference
from dic.correlation.period_choice import PeriodChoice, tells_apart
from dic.correlation.prepared_reference import PreparedReference
from dic.correlation.repetition import find_repetition, naming_repetition, remark, repeats
from dic.correlation.seeds import FEWEST_SEEDS, SeedFinder, Seeds, scattered
from dic.correlation.settings import CorrelationSettings
from dic.correlation.smoothing import chosen_smoothing
from dic.correlation.solver import Solver
from dic.correlation.status import Status
from dic.correlation.turned_image import TurnableImage
from dic.correlation.twins import Twins, Unlike
from dic.errors import CorrelationError, require_kind
from dic.image.given import fixed, fixed_region, grey_levels, kept
from dic.image.memory import give_back_memory
from dic.image.point_grid import PointGrid, clear_of_edges, place_points
from dic.image.spline import edge_reach_px
from dic.image.stored import everywhere
from dic.image.threads import processors
from dic.specimen.find import Specimen, find_specimen
from dic.typing import Float, ImageLike, Indices, Mask, PathLike

_LOST_SHARE = 0.05
"""New seeds are searched among failed points only if at least this fraction of all points failed."""


class Correlator:
    """Correlate deformed images with one reference image, which is prepared once.

    Parameters
    ----------
    reference : ndarray, shape (height, width), or path
        Grey levels, or an image file.
    region : ndarray of bool, shape (height, width), or path, optional
        Region of interest, in which points are measured. The default is the specimen, which is found by its
        speckles (see `dic.find_specimen`).
    settings : CorrelationSettings, optional
    clip : bool
        True to use only pixels that the region's edge does not disturb. Pixels near the edge are disturbed,
        because a cubic spline oscillates up to 4 px from an edge, and a quintic spline up to 5 px. Give True
        if the surface ends at the region's edge. Without a region, subsets never use pixels outside the
        specimen.
    within : ndarray of bool, shape (height, width), optional
        Limits the points of interest, but not the pixels of their subsets, to a part of the region or of the
        specimen.
    hint_decides : bool
        True if a hint may decide between the periods of a pattern that repeats. The hint must then be right
        within a fraction of the period.
    threads : int
        Number of threads. 0 means one thread for each processor.
    copy : bool
        False if the array `reference` is never changed later. This saves the memory of a copy, which matters
        for large images.

    Attributes
    ----------
    region : ndarray of bool, shape (height, width)
        The region of interest: the given region or the specimen, within `within`. The mask is read-only.
    specimen : Specimen or None
        The specimen that was found; None if a region was given.
    repetition : Repetition or None
        How the pattern repeats; None if it does not.
    smoothing : Smoothing
        The filter that is applied to all images before they are interpolated.

    Raises
    ------
    CorrelationError
        If the image cannot be used, if it shows no specimen, or if no point fits in the region.
    """

    def __init__(
        self,
        reference: ImageLike,
        region: Mask | PathLike | None = None,
        settings: CorrelationSettings | None = None,
        *,
        clip: bool = True,
        within: Mask | None = None,
        hint_decides: bool = True,
        threads: int = 0,
        copy: bool = True,
    ) -> None:
        require_kind("settings", settings, CorrelationSettings | None, "give dic.CorrelationSettings()")
        self.settings = settings = settings or CorrelationSettings()
        grey = _checked_reference(reference, settings.subset_px)
        if copy:
            # Parts of the image are prepared when they are used, and the array may have another image then.
            grey = kept(grey, reference)
        threads = threads or processors()
        self.specimen: Specimen | None = None
        if region is None:
            with naming_repetition(grey):
                self.specimen = find_specimen(grey, settings.subset_px, within)
            surface = self.specimen.mask
        else:
            surface = fixed_region(region, grey.shape)
        self.region = fixed(surface if within is None else surface & within)
        self.smoothing = chosen_smoothing(grey, self.region, settings)
        image = self.smoothing.applied(grey)
        usable = everywhere(grey.shape)
        if region is None or clip:
            reach_px = edge_reach_px(settings.order) + self.smoothing.reach_px
            usable = clear_of_edges(surface, settings.subset_px, reach_px)
        grid = place_points(self.region, usable, settings.subset_px, settings.step_px)
        mean = image.mean()
        laid = LaidReference(image, usable, settings.order, mean, threads)
        self._reference = PreparedReference(laid, mean, grid, settings, threads, self.smoothing)
        self._seed_finder = SeedFinder(self._reference, image)
        self.repetition = find_repetition(image, self.region)
        self._image, self._hint_decides = image, hint_decides
        self._unlike: Unlike | None = None

    def __repr__(self) -> str:
        height, width = self.region.shape
        points = int(self._reference.grid.active.sum())
        settings = f"subset {self.settings.subset_px} px, step {self.settings.step_px} px"
        return f"Correlator({width} × {height} px, {points} points, {settings})"

    @property
    def prepared(self) -> PreparedReference:
        """The data of the reference that do not depend on the deformed images."""
        return self._reference

    @property
    def grid(self) -> PointGrid:
        """The points of interest, and the pixels that their subsets use."""
        return self._reference.grid

    def correlate(
        self, deformed: ImageLike, *, previous: Field | None = None, hint: Float | None = None
    ) -> Field:
        """Return the displacement field from the reference to the image `deformed`.

        Parameters
        ----------
        deformed : ndarray, of the reference's shape, or path
        previous : Field, optional
            The field of an earlier image. The field is a good first guess if the specimen has moved little
            since the earlier image.
        hint : ndarray, shape (3, 3), optional
            Expected homography from the reference to the deformed image. For a known rotation, such as the
            angle of a stage, `dic.correlation.rigid_motion` returns the homography.

        Raises
        ------
        CorrelationError
            If the image cannot be used, or if it does not show the reference's pattern.
        """
        require_kind("previous", previous, Field | None, "give the field of the image before")
        hint = None if hint is None else checked_homography(hint)
        return self.correlate_after(None if previous is None else EarlierField.of(previous), deformed, hint)

    def correlate_after(
        self, earlier: EarlierField | None, deformed: ImageLike, hint: Float | None = None
    ) -> Field:
        """Return the field of `correlate`; `earlier` has those parts of `previous` that are needed."""
        image = TurnableImage(self._reference, self.smoothing.applied(self._checked_deformed(deformed)))
        seeds = self._first_seeds(image, earlier, hint)
        solver = image.solver(seeds.quarters)
        solution = kernel.Solution.empty(self._reference.grid.active.shape, self.settings.parameters)
        self._solve_from_seeds(solver, solution, seeds)
        self._reject_inconsistent(solver, solution)
        if self._solve_lost_points(image, seeds.quarters, solution, earlier):
            self._reject_inconsistent(solver, solution)
        repetition = self._settle_periods(image, seeds.quarters, solution, hint)
        failed = ~solution.converged
        solution.warps[failed] = solution.std[failed] = np.nan
        solution.std[...] *= np.repeat(self.smoothing.std_factors, 3)
        solution = image.turned_back(solution, seeds.quarters)
        if self._reference.image.in_bands:
            give_back_memory()
        grid = self._reference.grid
        return Field(
            grid.x, grid.y, solution.warps, solution.std, solution.zncc, solution.iterations,
            solution.status, grid.active, seeds.start, self.settings, region=self.region, grid=grid,
            smoothing_px=self.smoothing.width_px, greatest_bias_px=self.smoothing.bias_px,
            repetition=repetition,
        )  # fmt: skip

    def seek(self, deformed: ImageLike, indices: Indices) -> Seeds:
        """Search points in an image, wherever they may be; return those that predict one another.

        Parameters
        ----------
        deformed : ndarray, of the reference's shape, or path
        indices : ndarray, shape (n, 2)
            Row and column of the points in the grid.
        """
        image = TurnableImage(self._reference, self.smoothing.applied(self._checked_deformed(deformed)))
        return self._seed_finder.find(image, indices, quarters=0)

    def tells_periods_apart(self, noise: float) -> bool:
        """Return True if subsets differ enough from those one period away to be measured.

        Parameters
        ----------
        noise : float
            Standard deviation of the noise of an image, grey levels.
        """
        if self.repetition is None:
            return True
        grey = self._image.rows(0, self.region.shape[0])[self.region]
        unlike = self._unlike_twins(Twins(self._reference, self.repetition))
        return tells_apart(unlike, noise**2 / max(float(grey.var()), 1e-9))

    def _unlike_twins(self, twins: Twins) -> Unlike:
        if self._unlike is None:
            solver = TurnableImage(self._reference, self._image).solver(0)
            self._unlike = twins.unlike(solver, self._image)
        return self._unlike

    def _checked_deformed(self, deformed: ImageLike) -> NDArray[Any]:
        """Return the grey levels; raise `CorrelationError` if the size differs from the reference's."""
        grey, shape = grey_levels(deformed, "deformed image"), self.region.shape
        if grey.shape != shape:
            raise CorrelationError(
                "deformed image",
                "compare with the reference",
                f"{shape[1]} x {shape[0]} px",
                f"{grey.shape[1]} x {grey.shape[0]} px",
                f"use images that one camera took with one readout region, all {shape[1]} x {shape[0]} px",
            )
        return grey

    def _first_seeds(self, image: TurnableImage, earlier: EarlierField | None, hint: Float | None) -> Seeds:
        """Return seeds, which are the start points of propagation, spread over the whole grid."""
        indices = scattered(self._reference.grid.active)
        before = None if earlier is None else earlier.warps
        near_px = None if self.repetition is None else int(self.repetition.periods_px.min() / 2)
        seeds = self._seed_finder.find(image, indices, previous=before, hint=hint, near_px=near_px)
        fewest = min(FEWEST_SEEDS, len(indices))
        if len(seeds.indices) < fewest:
            subset_px = self.settings.subset_px
            raise CorrelationError(
                "deformed image",
                "find the reference's pattern",
                f"at least {fewest} of {len(indices)} subsets of {subset_px} px"
                f" with ZNCC above {self.settings.min_zncc:g} that predict one another",
                f"{len(seeds.indices)}"
                + ("" if self.repetition is None else f"; {repeats(self.repetition)}"),
                "check that both images show the same textured surface, or give a larger subset, such as"
                f" {subset_px + 20} px",
            )
        return seeds

    def _solve_from_seeds(self, solver: Solver, solution: kernel.Solution, seeds: Seeds) -> None:
        """Solve all points by propagation from the seeds, which are already solved.

        Points that propagation does not reach, for example behind a gap in the region, start from a guess
        that is extrapolated from the nearest converged point.
        """
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
        self, image: TurnableImage, quarters: int, solution: kernel.Solution, earlier: EarlierField | None
    ) -> bool:
        """Search new start points among failed points, because failed points may lie on a second body.

        A second body can move in another way than the first. New start points ("seeds") are searched only
        among points that converged in the earlier image. So points that have failed in many images of a
        series are not searched again in every image. Return True if new seeds were found.
        """
        grid = self._reference.grid
        lost = grid.active & ~solution.converged & (solution.status != Status.OUT_OF_VIEW)
        if earlier is not None:
            lost &= earlier.converged
        if lost.sum() < max(FEWEST_SEEDS, _LOST_SHARE * grid.active.sum()):
            return False
        seeds = self._seed_finder.find(image, scattered(lost), quarters=quarters)
        if len(seeds.indices) < FEWEST_SEEDS:
            return False
        self._solve_from_seeds(image.solver(quarters), solution, seeds)
        return True

    def _settle_periods(
        self, image: TurnableImage, quarters: int, solution: kernel.Solution, hint: Float | None
    ) -> str:
        """Decline points of a pattern that repeats if nothing decides their period; return a sentence."""
        if self.repetition is None:
            return ""
        grid, expected = self._reference.grid, None
        if hint is not None and self._hint_decides:
            points = grid.points_at(np.argwhere(np.ones_like(grid.active)))
            warps = image.turned(homography_warps(hint, points.astype(np.float64)), points, quarters)
            expected = warps.reshape(*grid.active.shape, 6)
        twins = Twins(self._reference, self.repetition)
        unlike = self._unlike_twins(twins)
        choice = PeriodChoice(self._reference, twins, unlike, image.solver(quarters))
        hinted = choice.settle(solution, expected)
        known = np.count_nonzero(grid.active & solution.converged)
        declined = np.count_nonzero(grid.active & (solution.status == Status.REPEATING))
        return remark(self.repetition, declined / (declined + known) if known else 1.0, hinted=hinted)

    def _reject_inconsistent(self, solver: Solver, solution: kernel.Solution) -> None:
        """Try points again whose displacement no neighbour predicts, and reject those that fail again.

        When a point is tried again, it starts from the warp of a consistent neighbour.
        """
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


def _checked_reference(reference: ImageLike, subset_px: int) -> NDArray[Any]:
    """Return the grey levels; raise `CorrelationError` if the image is smaller than a subset."""
    grey = grey_levels(reference, "reference image")
    if min(grey.shape) < subset_px:
        raise CorrelationError(
            "reference image",
            "read",
            f"an image that holds a subset of {subset_px} px",
            f"{grey.shape[1]} x {grey.shape[0]} px",
            "use a larger image, or give a smaller subset (odd, at least 7 px)",
        )
    return grey
