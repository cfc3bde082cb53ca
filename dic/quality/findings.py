"""Limits for the quality of an image, and a remedy for each limit that an image exceeds.

The limits are those of a published guide, where the guide gives a limit: International Digital Image
Correlation Society, "A Good Practices Guide for Digital Image Correlation", 2018, DOI
10.32720/idics/gpg.ed1.
"""

import numpy as np

from dic.correlation.repetition import REMEDY, repeats
from dic.quality.picture import PictureValues
from dic.quality.quality import SPECKLES_PER_SUBSET, Quality

FINEST_SPECKLE_PX = 3.0
"""Smallest good size of a speckle. A smaller speckle is aliased, which causes a bias of the displacement."""

BARE_SHARE = 0.02
"""Largest acceptable share of subsets that show no pattern."""
CLIPPED_SHARE = 0.01
LEAST_CONTRAST = 0.2
WORST_BLUR_PX = 2.0
UNEVEN_BLUR = 1.5
"""Largest acceptable ratio of the blur in the worst ninth of the image to the median blur."""
LEAST_WHITENESS = 0.7


def quality_findings(quality: Quality) -> list[str]:
    """Return one sentence, with a remedy, for each quality limit that an image exceeds."""
    return [
        *_pattern_findings(quality),
        *_repetition_findings(quality),
        *_light_findings(quality),
        *_noise_findings(quality),
        *_focus_findings(quality),
    ]


def picture_findings(picture: PictureValues) -> list[str]:
    """Return sentences on light and focus, with remedies, for a picture with or without a pattern."""
    return [*_light_findings(picture), *_focus_findings(picture)]


def _pattern_findings(quality: Quality) -> list[str]:
    sentences = []
    subset = quality.settings.subset_px
    for axis, size in (("x", quality.speckle_x_px), ("y", quality.speckle_y_px)):
        if size < FINEST_SPECKLE_PX:
            sentences.append(
                f"speckles are {size:.1f} px wide along {axis}, finer than {FINEST_SPECKLE_PX:g} px: they"
                " alias; use a coarser pattern or a larger image scale"
            )
        elif SPECKLES_PER_SUBSET * size > subset:
            sentences.append(
                f"speckles are {size:.1f} px wide along {axis}, so a subset of {subset} px holds fewer than"
                f" {SPECKLES_PER_SUBSET:g} in a row; use a larger subset or a finer pattern"
            )
    if quality.bare_share > BARE_SHARE:
        sentences.append(
            f"{quality.bare_share:.0%} of the subsets of {subset} px show no pattern beyond noise;"
            " leave them out by a region of interest, or use more light"
        )
    if quality.floor_px > quality.wanted_px:
        recommended = quality.recommended_subset_px
        remedy = (
            f"a subset of {recommended} px"
            if recommended
            else "more light, more contrast, or a mean of images"
        )
        sentences.append(
            f"noise lets a subset of {subset} px resolve {quality.floor_px:.4f} px, not the wanted"
            f" {quality.wanted_px:g} px; use {remedy}"
        )
    return sentences


def _repetition_findings(quality: Quality) -> list[str]:
    if quality.repetition is None or quality.told_apart:
        return []
    return [f"{repeats(quality.repetition)}, and subsets one period apart look the same; {REMEDY}"]


def _light_findings(picture: PictureValues) -> list[str]:
    sentences = []
    for share, what, remedy in (
        (picture.dark_share, "darkest", "use more light or a lower black level"),
        (picture.bright_share, "brightest", "use less light, gain or exposure"),
    ):
        if share > CLIPPED_SHARE:
            sentences.append(f"{share:.1%} of the pixels are clipped at the {what} grey level; {remedy}")
    if picture.contrast < LEAST_CONTRAST:
        sentences.append(
            f"contrast is {picture.contrast:.2f}, below {LEAST_CONTRAST:g}; use a darker or brighter"
            " paint, diffuse light and no reflections"
        )
    return sentences


def _noise_findings(quality: Quality) -> list[str]:
    if quality.whiteness < LEAST_WHITENESS:
        return [
            "the noise of neighbouring pixels is correlated: the camera or the file format has smoothed the"
            " image, so the true noise floor is higher; take raw images"
        ]
    return []


def _focus_findings(picture: PictureValues) -> list[str]:
    known = picture.blur_px[np.isfinite(picture.blur_px)]
    if not known.size:
        return []
    median, worst = float(np.median(known)), float(known.max())
    if median > WORST_BLUR_PX:
        return [f"edges are blurred by {median:.1f} px, more than {WORST_BLUR_PX:g} px; focus the lens"]
    if worst > WORST_BLUR_PX and worst > UNEVEN_BLUR * median:
        row, column = np.argwhere(picture.blur_px == worst)[0]
        where = f"{('top', 'middle', 'bottom')[row]} {('left', 'middle', 'right')[column]}"
        return [
            f"edges are blurred by {worst:.1f} px at the {where} and by {median:.1f} px elsewhere;"
            " focus on the middle and stop down the lens"
        ]
    return []
