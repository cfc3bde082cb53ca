"""The dots of a lattice in an image: detection, lattice indices, and measured centres.

The image of a dot is an ellipse. In perspective, the centre of this ellipse is slightly beside the image of
the dot's centre. The measured centres are corrected for this shift.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from dic.errors import CalibrationError
from dic.targets.blobs import Blobs, find_blobs, noise_of
from dic.targets.cells import along_short_vectors, lattice_of_regions
from dic.targets.ellipses import Ellipses, fit_ellipses, rough_misfit
from dic.targets.hollow_marks import hollow_dots
from dic.targets.lattice import LatticeShape, fits_lattice
from dic.targets.not_seen import TargetNotSeen
from dic.targets.region import two_targets
from dic.typing import Float, Grey, Indices, Mask

FEWEST_DOTS = 16
# A second lattice is another plate if it has at least the share `_SECOND_PLATE` of the dots of the first. It
# is a part of the same plate if at least the share `_SAME_PLATE` of its dots lie on the first lattice, within
# `_WHOLE` pitches along both axes. In another plate, 16 % of the dots lie there by chance.
_SECOND_PLATE, _WHOLE, _SAME_PLATE = 0.5, 0.2, 0.5
# A sound dot has at most this misfit and at least this contrast, both as multiples of the median.
_MISFIT, _CONTRAST = 2.0, 0.3
# Even without noise, rounding and interpolation cause a misfit of this fraction of the contrast.
_MISFIT_OF_CONTRAST = 0.02
# Regions are not ellipses if their misfit is above this fraction of the contrast. Squares reach 0.2.
_NOT_ROUND = 0.1
# First, only `_FIRST_FITTED` regions are fitted. If their misfit is above the fraction `_CLEARLY_NOT_ROUND`
# of the contrast, they are clearly not round, and no more regions are fitted.
_FIRST_FITTED, _CLEARLY_NOT_ROUND = 24, 0.13
# A reflection disturbs a dot if the share of saturated pixels near the dot's edge is above `_SATURATED`, and
# above `_OF_USUAL_SATURATION` times the median share of all dots. So a background that is saturated
# everywhere excludes no dot.
_SATURATED, _OF_USUAL_SATURATION = 0.01, 2.0
# A dot is divided into this number of rings and spokes, over which the shift by perspective is integrated.
_RINGS, _SPOKES = 6, 24


@dataclass(frozen=True)
class MeasuredDots:
    """The dots of one lattice in an image, with their centres."""

    index: Indices
    """Shape (n, 2). Lattice indices of the dots. Both lattice vectors are equally long on the plate, and
    perpendicular.
    """
    centre_px: Float
    """Shape (n, 2). Images of the dots' centres."""
    sound: Mask
    """Shape (n,). True for dots whose centre is accurate: whole dots that fit the lattice, away from
    reflections.
    """
    hollow: Mask
    """Shape (n,). True for rings."""
    vectors_px: Float
    """Shape (2, 2). The two lattice vectors in the image, px, in the middle of the lattice."""
    in_glare: int
    """Number of dots that were left out because of a reflection."""

    @property
    def beside_a_reflection(self) -> str:
        """The part of an error message about the dots beside a reflection; empty if there are none."""
        return f", and {self.in_glare} where a reflection saturates the picture" if self.in_glare else ""


def measure_dots(
    grey: Grey, enough: int, source: str, refusal: Callable[[str, type[CalibrationError]], CalibrationError]
) -> MeasuredDots:
    """Return the dots of the largest lattice in an image.

    `enough`: the search ends as soon as a lattice has this number of dots. `source`: name of the image, used
    in error messages. `refusal`: function that returns the error to raise, from a text that says what was
    found instead of the target.

    Raises `CalibrationError` if no lattice of at least 16 round dots is found, or if the image shows two such
    lattices.
    """
    not_round = "regions that are not round, such as squares or the cells of a line grid"
    lattice = _Lattice.in_image(grey, enough)
    if lattice is None:
        raise refusal("no lattice of dots", TargetNotSeen)
    if lattice.is_clearly_not_round(grey):
        raise refusal(not_round, TargetNotSeen)
    found = _Dots.fitted(grey, lattice)
    if np.count_nonzero(sound := found.sound()) < FEWEST_DOTS:
        raise refusal("no lattice of dots", TargetNotSeen)
    if lattice.beside is not None:
        raise two_targets(source, "dots", (lattice.blobs.centre_px, lattice.beside))
    if not found.are_round(grey, sound):
        raise refusal(not_round, TargetNotSeen)
    index, centre = found.index.astype(float), found.ellipses.centre_px
    shape = LatticeShape.fit(index[sound], centre[sound])
    centre = centre - _eccentricity(shape, index, found.ellipses.area_px2, sound)
    # A partly hidden dot looks smaller than other dots, and its measured centre is shifted. Leave such dots
    # out.
    size = found.ellipses.area_px2 / _cell_px2(shape, index)
    off = np.abs(size / np.median(size[sound]) - 1)
    glare = found.in_glare()
    sound &= (off < 6 * np.median(off[sound]) + 0.02) & ~glare
    sound[sound] = fits_lattice(index[sound], centre[sound])
    middle = (index.min(axis=0) + index.max(axis=0)) / 2
    vectors = np.stack([shape.step(middle, 0), shape.step(middle, 1)])
    return MeasuredDots(found.index, centre, sound, found.hollow, vectors, int(np.count_nonzero(glare)))


def dots_not_found(
    source: str,
    expected: str,
    counts: str,
    got: str,
    kind: type[CalibrationError] = CalibrationError,
    remedy: str = "",
) -> CalibrationError:
    """Return the error about an image without the dots; `counts` says which option gives their numbers."""
    check = f"check that all dots are in view, sharp and evenly lit, and that {counts}"
    return kind(source, "find dots", expected, got, remedy or check)


def round_dots(grey: Grey) -> tuple[Indices, Mask] | None:
    """Return the lattice indices (n, 2) of the largest lattice's dots, and which dots are rings; or None."""
    lattice = _Lattice.in_image(grey, grey.size)
    if lattice is None or lattice.is_clearly_not_round(grey):
        return None
    found = _Dots.fitted(grey, lattice)
    sound = found.sound()
    if np.count_nonzero(sound) < FEWEST_DOTS or not found.are_round(grey, sound):
        return None
    return found.index, found.hollow


@dataclass(frozen=True)
class _Lattice:
    """A lattice of blobs: lattice indices (n, 2), blobs, and which of them are rings.

    `beside` are the dots (m, 2), px, of another plate in the image.
    """

    index: Indices
    blobs: Blobs
    hollow: Mask
    beside: Float | None

    @classmethod
    def in_image(cls, grey: Grey, enough: int) -> "_Lattice | None":
        """Return the largest lattice of blobs, or None if no lattice has 16 dots.

        The search ends as soon as a lattice has `enough` dots.
        """
        most = 0
        for candidates in find_blobs(grey):
            found, placed = lattice_of_regions(candidates.centre_px, candidates.area_px2)
            if len(found) > most and len(found) >= FEWEST_DOTS:
                blobs = candidates.only(placed)
                index = _along_squares(found, blobs)
                beside = _other_plate(candidates, placed, index)
            most = max(most, len(found))
            if most >= enough:
                break
        if most < FEWEST_DOTS:
            return None
        return cls(index, blobs, hollow_dots(grey, blobs), beside)

    def is_clearly_not_round(self, grey: Grey) -> bool:
        """Return True if ellipses do not fit the grey levels of some of the blobs."""
        count = len(self.blobs)
        some = np.linspace(0, count - 1, min(count, _FIRST_FITTED)).astype(np.int64)
        fits = rough_misfit(grey, self.blobs, self.hollow, some)
        misfit, contrast = (float(np.median(np.abs(values))) for values in fits)
        # If a fit failed and gave NaN, the comparison is False. Then all blobs are fitted.
        return bool(misfit > _CLEARLY_NOT_ROUND * contrast + 1.3 * noise_of(grey))


@dataclass(frozen=True)
class _Dots:
    """The dots of a lattice: lattice indices (n, 2), which of them are rings, and fitted ellipses."""

    index: Indices
    hollow: Mask
    ellipses: Ellipses

    @classmethod
    def fitted(cls, grey: Grey, lattice: _Lattice) -> "_Dots":
        """Fit ellipses to all blobs of a lattice."""
        ellipses = fit_ellipses(grey, lattice.blobs, lattice.hollow)
        return cls(lattice.index, lattice.hollow, ellipses)

    def are_round(self, grey: Grey, sound: Mask) -> bool:
        """Return True if ellipses fit the grey levels of the sound dots (n,), at least one, of the image."""
        usual_misfit, usual = (
            float(np.median(values[sound]))
            for values in (self.ellipses.misfit, np.abs(self.ellipses.contrast))
        )
        return usual_misfit <= _NOT_ROUND * usual + 1.3 * noise_of(grey)

    def in_glare(self) -> Mask:
        """Return True for each dot (n,) beside which a reflection saturates the picture.

        Beside a reflection the gradient of the light is not known, and the centre would be wrong by up to 0.1
        px.
        """
        usual = float(np.median(self.ellipses.saturated))
        return np.asarray(self.ellipses.saturated > max(_SATURATED, _OF_USUAL_SATURATION * usual))

    def sound(self) -> Mask:
        """Return True for each dot (n,) whose ellipse fits the grey levels about as well as for most dots."""
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
    """Return the dots (m, 2), px, of a second plate beside the plate of the blobs `placed`, or None.

    The second lattice must be at least half as large as the first. A reflection can divide one plate into two
    parts. Two such parts do not count as two plates. Two parts of one plate are recognised because the
    lattice of one part continues in the other part.
    """
    import cv2

    rest = np.setdiff1d(np.arange(len(blobs)), placed)
    if len(placed) < FEWEST_DOTS or len(rest) < _SECOND_PLATE * len(placed):
        return None
    numbers, others = lattice_of_regions(blobs.centre_px[rest], blobs.area_px2[rest])
    if len(numbers) < max(FEWEST_DOTS, _SECOND_PLATE * len(placed)):
        return None
    centre = blobs.centre_px[rest[others]]
    to_index, _ = cv2.findHomography(blobs.centre_px[placed], index.astype(np.float64))
    if to_index is None:
        return None
    there = cv2.perspectiveTransform(centre[:, None], to_index)[:, 0]
    whole = (np.abs(there - np.rint(there)) < _WHOLE).all(axis=1)
    return None if whole.mean() > _SAME_PLATE else centre


def _along_squares(index: Indices, blobs: Blobs) -> Indices:
    """Change lattice indices (n, 2) so that they count along the sides of the lattice's squares.

    Seen from the front, all dots are round. An oblique view shortens one direction, so the shortest vectors
    in the image may be diagonals of the squares. Therefore the function first applies the affine map that
    makes the median blob round, and then takes the shortest vectors. In the result, the second direction is
    anticlockwise from the first.
    """
    usual = np.median(blobs.covariance_px2 / blobs.area_px2[:, None, None], axis=0)
    front: Float = np.linalg.solve(np.linalg.cholesky(usual), blobs.centre_px.T).T
    index = along_short_vectors(index, front)
    affine = np.linalg.lstsq(np.column_stack([index, np.ones(len(index))]), front, rcond=None)[0]
    # The image's y axis points down, so a negative determinant means anticlockwise.
    return index if np.linalg.det(affine[:2]) < 0 else index[:, ::-1].copy()


def _eccentricity(shape: LatticeShape, index: Float, area_px2: Float, sound: Mask) -> Float:
    """Return the shifts (n, 2), px, from the image of each dot's centre to the centre of the dot's image.

    In perspective these two points differ. The function divides the dot into small elements. The centre of
    the dot's image is the mean of the elements' images, weighted by their areas in the image.
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
