"""Detection of the centres of round dots.

The centre of a dot is the centre of the ellipse that is its image, corrected for the shift that perspective
causes.
"""

from dataclasses import dataclass

import numpy as np

from dic.errors import CalibrationError
from dic.targets.axes import Axes, XAxis, axes_in_image
from dic.targets.blobs import Blobs, find_blobs, noise_of
from dic.targets.cells import along_short_vectors, lattice_of_regions
from dic.targets.ellipses import Ellipses, fit_ellipses
from dic.targets.hollow_marks import HollowMarks, find_hollow_marks, hollow_dots
from dic.targets.lattice import LatticeShape, fits_lattice
from dic.targets.not_seen import TargetNotSeen
from dic.targets.points import GridPoints
from dic.targets.region import two_targets
from dic.typing import Float, Grey, Indices, Mask

# Smallest share of the dots that must be found; of a plate with marks, of the dots in the picture.
_SUFFICIENT, _SUFFICIENT_WITH_MARKS = 0.9, 0.5
_FEWEST = 16
# Size of a second plate relative to the first. Largest distance of an index from a whole number, and share of
# such indices in another part of the same plate. In another plate, 16 % of the indices are such by chance.
_SECOND_PLATE, _WHOLE, _SAME_PLATE = 0.5, 0.2, 0.5
# Smallest share of the places in a lattice that must have dots. Speckles seldom fill a lattice.
_FILLED = 0.6
# Limits, in units of the median, of the misfit and of the contrast of a sound dot.
_MISFIT, _CONTRAST = 2.0, 0.3
# Rounding and interpolation cause a misfit of this fraction of the contrast also without noise.
_MISFIT_OF_CONTRAST = 0.02
# Misfit, as a fraction of the contrast, above which regions are not ellipses. Squares reach 0.2.
_NOT_ROUND = 0.1
# A reflection disturbs a dot if the share of saturated pixels near the dot's edge is above the first number,
# and above the second number times the median share of all dots. A background that is saturated everywhere
# does no harm.
_SATURATED, _OF_USUAL_SATURATION = 0.01, 2.0
# A dot is divided into this number of rings and spokes, over which the shift by perspective is integrated.
_RINGS, _SPOKES = 6, 24


@dataclass(frozen=True)
class _Dots:
    """The dots of a lattice: lattice indices (n, 2), approximate blobs, and fitted ellipses.

    `beside` are the dots (m, 2), px, of another plate in the image.
    """

    index: Indices
    blobs: Blobs
    hollow: Mask
    ellipses: Ellipses
    beside: Float | None

    @classmethod
    def in_image(cls, grey: Grey, enough: int) -> "_Dots | None":
        """Return the dots of the largest lattice of blobs, or None if no lattice has 16 dots.

        The search ends as soon as a lattice has `enough` dots.
        """
        most = 0
        for candidates in find_blobs(grey):
            found, placed = lattice_of_regions(candidates.centre_px, candidates.area_px2)
            if len(found) > most and len(found) >= _FEWEST:
                index = along_short_vectors(found, candidates.centre_px[placed])
                blobs, beside = candidates.only(placed), _other_plate(candidates, placed, index)
            most = max(most, len(found))
            if most >= enough:
                break
        if most < _FEWEST:
            return None
        hollow = hollow_dots(grey, blobs)
        ellipses = fit_ellipses(grey, blobs, hollow)
        return cls(index, blobs, hollow, ellipses, beside)

    def are_round(self, grey: Grey, sound: Mask) -> bool:
        """Return True if ellipses fit the grey levels of the sound dots (n,), at least one, of the image."""
        usual_misfit, usual = (
            float(np.median(values[sound]))
            for values in (self.ellipses.misfit, np.abs(self.ellipses.contrast))
        )
        return usual_misfit <= _NOT_ROUND * usual + 1.3 * noise_of(grey)

    def in_glare(self) -> Mask:
        """Return True for each dot (n,) beside which a reflection saturates the picture.

        There the gradient of the light is not known, and the centre would be off by up to 0.1 px.
        """
        usual = float(np.median(self.ellipses.saturated))
        return np.asarray(self.ellipses.saturated > max(_SATURATED, _OF_USUAL_SATURATION * usual))

    def sound(self) -> Mask:
        """Return True for each dot (n,) whose ellipse fits the grey levels about as well as usual."""
        fit = self.ellipses
        fitted = np.isfinite(fit.centre_px).all(axis=1)
        if not fitted.any():
            return np.asarray(fitted)
        contrast, misfit = np.abs(fit.contrast), fit.misfit
        usual = float(np.median(contrast[fitted]))
        limit = _MISFIT * float(np.median(misfit[fitted])) + _MISFIT_OF_CONTRAST * usual
        with np.errstate(invalid="ignore"):
            return np.asarray(fitted & (contrast > _CONTRAST * usual) & (misfit < limit))


def _other_plate(blobs: Blobs, placed: Indices, index: Indices) -> Float | None:
    """Return the dots (m, 2), px, of a lattice beside the lattice of the blobs `placed`, or None.

    The lattice beside must be at least half as large. A reflection can divide a plate into two parts. Such
    parts do not count as two plates, because the lattice of one part continues in the other part.
    """
    import cv2

    rest = np.setdiff1d(np.arange(len(blobs)), placed)
    if len(placed) < _FEWEST or len(rest) < _SECOND_PLATE * len(placed):
        return None
    numbers, others = lattice_of_regions(blobs.centre_px[rest], blobs.area_px2[rest])
    if len(numbers) < max(_FEWEST, _SECOND_PLATE * len(placed)):
        return None
    centre = blobs.centre_px[rest[others]]
    to_index, _ = cv2.findHomography(blobs.centre_px[placed], index.astype(np.float64))
    if to_index is None:
        return None
    there = cv2.perspectiveTransform(centre[:, None], to_index)[:, 0]
    whole = (np.abs(there - np.rint(there)) < _WHOLE).all(axis=1)
    return None if whole.mean() > _SAME_PLATE else centre


def find_dots(grey: Grey, dots: tuple[int, int], pitch_mm: float, source: str, x_axis: XAxis) -> GridPoints:
    """Return the centres of a lattice of dots. `dic.targets.find.DotTarget` describes this target.

    If three of the dots are hollow, they mark the origin and the axes, and the lattice may be larger than the
    picture. Dots that the image's rim cuts are left out.

    Raises
    ------
    CalibrationError
        If fewer than 90 % of the dots are found, or the numbers of rows and columns differ from `dots`. With
        marks: if fewer than half of the dots in the picture are found, or the dots do not fit into the
        lattice.
    """
    found = _Dots.in_image(grey, dots[0] * dots[1])
    if found is None or np.count_nonzero(sound := found.sound()) < _FEWEST:
        raise _refusal(source, dots, "no lattice of dots", TargetNotSeen)
    if found.beside is not None:
        raise two_targets(source, "dots", (found.blobs.centre_px, found.beside))
    if not found.are_round(grey, sound):
        got = "regions that are not round, such as squares or the cells of a line grid"
        raise _refusal(source, dots, got, TargetNotSeen)
    index, centre = found.index.astype(float), found.ellipses.centre_px
    shape = LatticeShape.fit(index[sound], centre[sound])
    centre = centre - _eccentricity(shape, index, found.ellipses.area_px2, sound)
    # A partly hidden dot is smaller than the others, and its centre is shifted. Leave such dots out.
    size = found.ellipses.area_px2 / _cell_px2(shape, index)
    off = np.abs(size / np.median(size[sound]) - 1)
    glare = found.in_glare()
    sound &= (off < 6 * np.median(off[sound]) + 0.02) & ~glare
    sound[sound] = fits_lattice(index[sound], centre[sound])
    middle = (index.min(axis=0) + index.max(axis=0)) / 2
    vectors = np.stack([shape.step(middle, 0), shape.step(middle, 1)])
    marks = find_hollow_marks(found.index, found.hollow, vectors)
    if marks is not None:
        return _numbered_by_marks(found.index[sound], centre[sound], marks, dots, pitch_mm, source)
    axes, spans = _axes_and_spans(found.index, vectors, dots, x_axis, source)
    if np.count_nonzero(sound) < _SUFFICIENT * dots[0] * dots[1]:
        beside = f", and {np.count_nonzero(glare)} where a reflection saturates the picture"
        got = f"only {np.count_nonzero(sound)} whole dots{beside if glare.any() else ''}"
        raise _refusal(source, dots, got)
    column_row, centre = axes.columns_and_rows(found.index, spans)[sound], centre[sound]
    by_row = np.lexsort((column_row[:, 0], column_row[:, 1]))
    return GridPoints.on_lattice(
        column_row[by_row], centre[by_row], dots, pitch_mm, axes.warnings, axes.orientation
    )


def dots_seen(grey: Grey) -> tuple[int, int] | None:
    """Return the numbers of dots along both directions of a lattice of round dots, or None."""
    found = _Dots.in_image(grey, grey.size)
    if (
        found is None
        or np.count_nonzero(sound := found.sound()) < _FEWEST
        or not found.are_round(grey, sound)
    ):
        return None
    first, second = (int(count) for count in np.ptp(found.index, axis=0) + 1)
    return (first, second) if len(found.index) >= _FILLED * first * second else None


def _axes_and_spans(
    index: Indices, vectors: Float, dots: tuple[int, int], x_axis: XAxis, source: str
) -> tuple[Axes, tuple[range, range]]:
    """Return the axes and the ranges of lattice indices of a plate without marks, all of it in view."""
    if len(index) < _SUFFICIENT * dots[0] * dots[1]:
        raise _refusal(source, dots, f"{len(index)} dots in a lattice, without three hollow dots as marks")
    counts = tuple(int(count) for count in np.ptp(index, axis=0) + 1)
    if sorted(counts) != sorted(dots):
        raise _refusal(source, dots, f"{counts[0]} × {counts[1]} dots, without three hollow dots as marks")
    low = index.min(axis=0)
    spans = (range(int(low[0]), int(low[0]) + counts[0]), range(int(low[1]), int(low[1]) + counts[1]))

    def possible(axes: Axes) -> bool:
        return tuple(len(spans[axis]) for axis in axes.lattice_axes) == tuple(dots)

    return axes_in_image(vectors, x_axis, source, possible), spans


def _numbered_by_marks(
    index: Indices, centre: Float, marks: HollowMarks, dots: tuple[int, int], pitch_mm: float, source: str
) -> GridPoints:
    """Return the points of a plate with marks. The origin of X and Y is the origin mark."""
    signs = np.where(marks.axes.flip, -1, 1)
    from_mark = (index - marks.origin)[:, list(marks.axes.lattice_axes)] * signs
    low, high = from_mark.min(axis=0), from_mark.max(axis=0)
    seen = high - low + 1
    if (seen > dots).any():
        raise _refusal(source, dots, f"{seen[0]} × {seen[1]} dots, with the marks of a plate")
    # The marks of such plates lie symmetrically to the middle. Where the dots in view contradict this, the
    # nearest numbering that holds all dots is taken. X and Y do not depend on it.
    symmetric = (np.array(dots) - 1 - np.array(marks.pitches)) // 2
    column_row = from_mark + np.clip(symmetric, -low, np.array(dots) - 1 - high)
    if len(index) < max(_FEWEST, _SUFFICIENT_WITH_MARKS * _of_hull(index)):
        raise _refusal(source, dots, f"only {len(index)} whole dots between the outermost ones")
    by_row = np.lexsort((column_row[:, 0], column_row[:, 1]))
    xy_mm = from_mark[by_row].astype(np.float64) * pitch_mm
    return GridPoints(column_row[by_row], xy_mm, centre[by_row], dots, pitch_mm, (), "mark")


def _of_hull(index: Indices) -> float:
    """Return about how many dots a lattice without gaps has in the convex hull of the given dots."""
    from scipy.spatial import ConvexHull

    # Pick's theorem, with the rim taken as a rectangle's: area + half of the rim + 1.
    hull = ConvexHull(index)
    return float(hull.volume + hull.area / 2 + 1)


def _eccentricity(shape: LatticeShape, index: Float, area_px2: Float, sound: Mask) -> Float:
    """Return the differences (n, 2), px, between centres of dots' images and images of dots' centres.

    In perspective the centre of a dot's image is not the image of the dot's centre. The function computes the
    centre of the image as a sum over small elements of the dot, weighted by the areas of the elements in the
    image.
    """
    pixels_per_cell = _cell_px2(shape, index)
    radius = float(np.sqrt(np.median((area_px2 / pixels_per_cell)[sound]) / np.pi))
    ring = np.sqrt((np.arange(_RINGS) + 0.5) / _RINGS) * radius
    angle = np.arange(_SPOKES) * (2 * np.pi / _SPOKES)
    disc = np.stack([np.outer(ring, np.cos(angle)), np.outer(ring, np.sin(angle))], axis=-1).reshape(-1, 2)
    places = index[:, None] + disc
    weight = _cell_px2(shape, places)[..., None]
    seen: Float = (shape.map(places) * weight).sum(axis=1) / weight.sum(axis=1) - shape.map(index)
    return seen


def _cell_px2(shape: LatticeShape, index: Float) -> Float:
    """Return the area, px², that one cell of the lattice has in the image, at lattice indices (…, 2).

    The result has the shape (…,).
    """
    first, second = shape.step(index, 0), shape.step(index, 1)
    area: Float = np.abs(first[..., 0] * second[..., 1] - first[..., 1] * second[..., 0])
    return area


def _refusal(
    source: str, dots: tuple[int, int], got: str, kind: type[CalibrationError] = CalibrationError
) -> CalibrationError:
    return kind(
        source,
        "find dots",
        f"{dots[0]} × {dots[1]} dots, at least {_SUFFICIENT:.0%} of them, or a plate with three hollow dots",
        got,
        "check that all dots are in view, sharp and evenly lit, and that --dots gives their numbers",
    )
