"""Signs that the reference and the deformed images of a series were given in the wrong order."""

import re
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

from dic.image.pages import in_natural_order, natural_key
from dic.image.times import SeriesTimes

_REFERENCE = re.compile(
    r"(?i)(^|[^a-z])(ref|reference|referenz|undeformed|unloaded|unstrained|initial|nullbild|zero)([^a-z]|$)"
)
_TARGET = re.compile(
    r"(?i)(^|[^a-z])(grid|calib\w*|target|che(ss|cker)board|charuco|dots|mask|roi)([^a-z]|$)"
)
_LAST_NUMBER = re.compile(r"\d+")
_MOST_TIMES = 50
"""Number of images whose times are read; a series given in the wrong order shows it at once."""


def doubts_about_order(reference: Path, images: Sequence[Path]) -> list[str]:
    """Return a sentence if the reference seems to be a deformed image: by its name, its number or its time.

    Strain between swapped images has the wrong sign and, at large strain, the wrong size; nothing else shows
    it.
    """
    named = [image for image in images if _REFERENCE.search(image.stem)]
    own = _REFERENCE.search(reference.stem) or _REFERENCE.fullmatch(reference.parent.name)
    if named and not own:
        return [_doubt(reference, f"{named[0].name}, which is named as a reference, is measured against it")]
    if images and _TARGET.search(reference.stem) and not _TARGET.search(images[-1].stem):
        return [f"is {reference.name} the reference? It is named as a calibration target; give another first"]
    every = [Path(path.name) for path in (*images, reference)]
    if images and _begin_alike(every) and in_natural_order(every)[-1].name == reference.name:
        return [_doubt(reference, "all other images come before it by their names")]
    if _rolls_over(every):
        why = "the numbers of the names run over from the largest to the smallest"
        return [f"is {reference.name} the reference? {why}; give the images in their order, one by one"]
    clock = SeriesTimes(reference)
    times = [clock.of(image) for image in images[:_MOST_TIMES]]
    taken = [time.time_s for time in times if time.source in ("exif", "video") and time.time_s is not None]
    if taken and max(taken) < 0.0:
        return [_doubt(reference, "all other images were taken before it")]
    return []


def _rolls_over(paths: Sequence[Path]) -> bool:
    """Return whether the counter of a camera has begun again, as in DSC_9998, DSC_9999, DSC_0001."""
    if len(paths) < 2 or not _begin_alike(paths):
        return False
    counters = [_LAST_NUMBER.findall(path.stem)[-1:] for path in paths]
    texts = [each[0] for each in counters if each]
    numbers = sorted(map(int, texts))
    digits = {len(text) for text in texts}
    if len(texts) < len(paths) or len(digits) != 1:
        return False
    most = 10 ** digits.pop()
    gap = max(after - before for before, after in pairwise(numbers))
    return numbers[0] <= len(paths) and numbers[-1] >= most - 1 - len(paths) and gap > 0.5 * most


def _begin_alike(paths: Sequence[Path]) -> bool:
    """Return whether names differ in numbers only, so that their order is that of the images."""
    shapes = {tuple(text for _, text in natural_key(path)[::2]) for path in paths}
    return len(shapes) == 1 and len(set(paths)) == len(paths)


def _doubt(reference: Path, why: str) -> str:
    return f"is {reference.name} the reference? {why}; swapped images give strain of the wrong sign"
