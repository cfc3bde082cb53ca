"""Find the specimen in an image, and say why the rest of the image is left out."""

from dataclasses import dataclass

import numpy as np

from dic.errors import CorrelationError, is_whole
from dic.image.given import checked_region, fixed, grey_levels, name_of
from dic.image.memory import give_back_memory
from dic.image.stored import is_large
from dic.specimen.outline import at_full_resolution, edges_of_speckles, outline
from dic.specimen.pooled_texture import pooled_texture_maps
from dic.specimen.surfaces import FirstLook, find_surfaces, first_look
from dic.specimen.texture import TextureMaps, texture_maps
from dic.typing import ImageLike, Mask, PathLike

NOTHING = "nothing but noise"
LINES = "lines and lone edges"
WEAK = "weak texture"
OTHERS = "other patterns and narrow parts"

NARROWEST_PX = 7
"""Smallest width of a subset, px."""

_WORTH_SAYING = 0.01
"""A reason is named only if at least this share of the image was left out for it."""


@dataclass(frozen=True, eq=False)
class Specimen:
    """The specimen that an image shows: all surfaces with speckles that are worth measuring.

    Attributes
    ----------
    mask : ndarray of bool, shape (height, width)
        True at the pixels of the specimen.
    surfaces : int
        Number of connected surfaces.
    share : float
        Share of the image that shows the specimen, from 0 to 1.
    left_out : dict
        Share of the image, from 0 to 1, that was left out for each reason.
    """

    mask: Mask
    surfaces: int
    share: float
    left_out: dict[str, float]

    def as_dict(self) -> dict[str, object]:
        """Return the share, the number of surfaces, and the shares that were left out, for JSON."""
        return {"share": self.share, "surfaces": self.surfaces, "left_out": self.left_out}

    @property
    def is_whole(self) -> bool:
        """True if the specimen is one surface, and no notable part of the image was left out."""
        return self.surfaces == 1 and not _reasons(self.left_out)

    def __str__(self) -> str:
        found = "1 surface" if self.surfaces == 1 else f"{self.surfaces} surfaces"
        text = f"specimen found on {100 * self.share:.0f} % of the image ({found})"
        reasons = _reasons(self.left_out)
        return f"{text}; left out: {reasons}" if reasons else text


class SpecimenNotFound(CorrelationError):
    """An image shows no surface that could be a specimen."""


def find_specimen(image: ImageLike, subset_px: int = 41, within: Mask | PathLike | None = None) -> Specimen:
    """Find the specimen in an image by its speckles.

    A surface belongs to the specimen if it is wider than a subset, and if its texture fulfils these
    conditions: it is stronger than the image's noise, it has slopes in every direction, and it is about as
    dense, sharp and bright as the rest of the specimen. The outline follows the outermost speckles and edges.
    Holes that are wider than the gaps between speckles are left out.

    Parameters
    ----------
    image : ndarray, shape (height, width), or path
    subset_px : int
        Width of the subsets, an odd number from 7 px.
    within : ndarray of bool, shape (height, width), or path, optional
        Part of the image in which the specimen is searched. The mask of the specimen is not cut at the edge
        of this part, but the shares and the number of surfaces count this part only.

    Raises
    ------
    MeasurementError
        If the image cannot be used; `SpecimenNotFound` if it shows no specimen.
    """
    _require_subset(subset_px)
    name = name_of(image, "reference image")
    grey = grey_levels(image, name)
    part = None if within is None else checked_region(within, grey.shape)
    large = is_large(grey.shape)
    maps = (pooled_texture_maps if large else texture_maps)(grey, subset_px)
    inner = np.ones(maps.grey.shape, np.bool_) if part is None else _reduced(part, maps.grey.shape)
    look = first_look(maps, inner)
    if large:
        give_back_memory()
    surfaces = find_surfaces(maps, look)
    reduction, window, reasons = maps.reduction, maps.window, _possible_reasons(maps, look)
    edges = None if surfaces is None else edges_of_speckles(maps, surfaces)
    parts = None if surfaces is None else (surfaces.windows, surfaces.inside)
    # The maps are no longer needed, and take several times as much memory as the image.
    del maps, look, surfaces
    if large:
        give_back_memory()
    if edges is None or parts is None:
        mask = np.zeros(grey.shape, np.bool_)
    else:
        mask = at_full_resolution(outline(edges, *parts, window), reduction, grey.shape)
    left_out = _left_out(reasons, _reduced(mask, inner.shape), inner)
    inside = mask if part is None else mask & part
    if not inside.any():
        raise SpecimenNotFound(
            name,
            "find the specimen",
            f"a surface with texture in every direction, wider than subsets of {subset_px} px",
            _reasons(left_out) or "no texture",
            f"name the region, or give another subset, such as {subset_px + 20} px",
        )
    counted = _reduced(inside, inner.shape) if large else inside
    searched = mask.size if part is None else np.count_nonzero(part)
    share = float(np.count_nonzero(inside) / searched)
    return Specimen(fixed(mask) if large else mask, _count(counted), share, left_out)


def _require_subset(subset_px: int) -> None:
    if not is_whole(subset_px) or subset_px < NARROWEST_PX:
        expected = f"a whole number from {NARROWEST_PX} px"
        raise CorrelationError("settings", "subset", expected, f"{subset_px} px", "give 41")


def _reduced(mask: Mask, shape: tuple[int, ...]) -> Mask:
    import cv2

    size = shape[::-1]
    return np.asarray(cv2.resize(mask.view(np.uint8), size, interpolation=cv2.INTER_NEAREST)).view(np.bool_)


def _count(mask: Mask) -> int:
    import cv2

    return int(cv2.connectedComponents(mask.view(np.uint8))[0]) - 1


def _possible_reasons(maps: TextureMaps, look: FirstLook) -> dict[str, Mask]:
    """Return the pixels that may be left out for each reason; the first reason of a pixel counts."""
    return {
        NOTHING: maps.only_noise,
        LINES: ~(look.dense & maps.above_noise),
        WEAK: look.weak,
        OTHERS: np.ones_like(look.weak),
    }


def _left_out(reasons: dict[str, Mask], found: Mask, inner: Mask) -> dict[str, float]:
    """Return the share of the inner part for each reason why pixels do not belong to the specimen."""
    rest, shares = inner & ~found, {}
    searched = max(1, int(np.count_nonzero(inner)))
    for reason, pixels in reasons.items():
        shares[reason] = int(np.count_nonzero(rest & pixels)) / searched
        rest = rest & ~pixels
    return shares


def _reasons(left_out: dict[str, float]) -> str:
    return ", ".join(
        f"{100 * share:.0f} % {reason}" for reason, share in left_out.items() if share >= _WORTH_SAYING
    )
