"""Find images that are missing in a series, from the numbers in their file names or from their times."""

import re
from collections.abc import Sequence
from pathlib import PurePath

import numpy as np

from dic.typing import Float, Indices

_NUMBER = re.compile(r"(.*?)(\d+)(\D*)", re.DOTALL)
_NEAR, _AHEAD, _LEAST, _LEAST_AFTER = 16, 8, 6, 3
"""Number of images beside a gap that give the usual interval, of images after it that must be late, and least
number of images beside it.
"""
_LATE = 0.5
"""All images after a gap are late by this share of the usual interval, or more."""
_TRIALS = np.linspace(0.85, 1.18, 67)
"""Trials of the usual interval, divided by the median."""
_ALIKE = 0.6
"""The phases of the times in the usual interval have a mean of at least this length; 1 if they are equal."""
_LEAST_WHOLE_S = 5.0
"""Images whose times are whole seconds must be this far apart to show gaps."""
_SAME_INTERVAL = 0.1
"""Largest relative difference of the interval that the user gave from that of the images' own times."""
_BESIDE, _SCATTER, _CLEAR, _WHOLE = 6, 0.14, 7.0, 0.3
"""A step of strain is compared with this number of steps on each side. Their scatter is at most the second
number times the usual step. The step exceeds the usual one by more than the third number times the scatter,
and differs from a multiple of it by less than the fourth number.
"""
_MOST_PLACES = 3


def places_of(images: Sequence[str]) -> Indices | None:
    """Return the place of each image in its series, from the numbers in the names; the first place is 0.

    Result: shape (images,). None if the names have no numbers that count images: the text around the numbers
    differs, the steps are not multiples of the usual step, or the numbers are times of day.
    """
    parts = [_NUMBER.fullmatch(_stem(image)) for image in images]
    found = [part.groups() for part in parts if part is not None]
    if len(found) < max(len(images), 2) or len({(before, after) for before, _, after in found}) > 1:
        return None
    numbers = np.array([float(digits) for _, digits, _ in found])
    steps = np.diff(numbers)
    if not (steps > 0.0).all():
        return None
    sizes, counts = np.unique(steps, return_counts=True)
    usual = sizes[int(np.argmax(counts))]
    minutes = min(len(digits) for _, digits, _ in found) >= 4 and (numbers % 100 < 60).all()
    if (steps % usual).any() or (minutes and np.ptp(numbers // 100) > 0):
        return None
    return np.concatenate([[0], np.cumsum(steps / usual)]).astype(np.int64)


def lost_by_time(times_s: Float) -> Indices:
    """Return how many images are missing before each image, shape (images,), from the images' times.

    An image that is late once, because its file was written late, leaves no gap: a gap delays all later
    images. A change of the interval between images is no gap either. Times without a fraction of a second
    show no gaps between images that were taken in quick succession.
    """
    lost = np.zeros(len(times_s), np.int64)
    steps = np.diff(times_s)
    if len(steps) < _LEAST or ((times_s % 1.0 == 0.0).all() and np.median(steps) < _LEAST_WHOLE_S):
        return lost
    for k in range(len(steps)):
        sides = times_s[max(k - _NEAR, 0) : k + 1], times_s[k + 1 : k + 2 + _NEAR]
        usual = max(float(np.median(np.diff(side))) if len(side) > 1 else 0.0 for side in sides)
        if steps[k] < (1.0 + _LATE) * _TRIALS[0] * usual:
            continue
        usual = max(_interval_s(sides[0][-_NEAR:]), _interval_s(sides[1][:_NEAR]))
        if usual > 0.0 and steps[k] > (1.0 + _LATE) * usual:
            back = np.arange(min(k, 2) + 1)
            places = back + lost[k] * (back > 0) + lost[k - 1] * (back > 1)
            before = np.median(times_s[k - back] + usual * places)
            after = sides[1][:_AHEAD]
            late = (after - before) / usual - np.arange(1, len(after) + 1)
            if len(late) >= _LEAST_AFTER and late.min() > _LATE:
                lost[k + 1] = max(1, round(float(late.min())))
    return lost


def _interval_s(times_s: Float) -> float:
    """Return the interval whose multiples are the differences of most times; 0 if there is none.

    The phases of the times in this interval are alike. So neither gaps nor late images change the interval.
    """
    if len(times_s) < _LEAST:
        return 0.0
    trials = max(float(np.median(np.diff(times_s))), 1e-9) * _TRIALS
    phases = np.exp(2j * np.pi * (times_s - times_s[0]) / trials[:, None])
    alike = np.abs(phases.mean(axis=1))
    return float(trials[int(np.argmax(alike))]) if alike.max() > _ALIKE else 0.0


def places_by_time(times_s: Float, interval_s: float) -> Indices | None:
    """Return the place of each image from its time; None if the images were not taken at this interval."""
    if len(times_s) < 3 or abs(np.median(np.diff(times_s)) / interval_s - 1.0) > _SAME_INTERVAL:
        return None
    return np.arange(len(times_s)) + np.cumsum(lost_by_time(times_s))


def lost_by_strain(strain: Float) -> Indices:
    """Return how many images may be missing before each image, shape (images,), from the strain alone.

    The strain then grows by a multiple of its usual step, between steps that are all alike. So plastic flow
    in jumps, the beginning of yielding and noise as large as the steps show nothing.
    """
    lost = np.zeros(len(strain), np.int64)
    steps = np.diff(strain)
    bends = np.abs(np.diff(steps, n=2))
    if not np.isfinite(bends).any():
        return lost
    # The third difference of white noise has 20 times its variance, a step twice.
    noise = 1.4826 * float(np.nanmedian(bends)) / np.sqrt(10.0)
    for k in range(_BESIDE, len(steps) - _BESIDE):
        sides = steps[k - _BESIDE : k], steps[k + 1 : k + 1 + _BESIDE]
        both = np.concatenate(sides)
        usual, ends = float(np.median(both)), [float(np.median(side)) for side in sides]
        scatter = max(noise, 1.4826 * float(np.median(np.abs(both - usual))))
        alike = scatter < _SCATTER * usual and np.ptp(ends) < 2.0 * _SCATTER * usual
        if alike and steps[k] - usual > _CLEAR * scatter:
            times = float(steps[k]) / usual
            lost[k + 1] = round(times) - 1 if abs(times - round(times)) < _WHOLE else 0
    return lost


def lost_sentence(images: Sequence[str], lost: Indices, because: str) -> str:
    """Return a sentence about the places where images are missing; "" if none are.

    `lost`: number of images that are missing before each image. `because`: what shows it.
    """
    at = np.flatnonzero(lost)
    if not at.size:
        return ""
    names = [PurePath(image.replace("\\", "/")).name for image in images]
    places = [f"{lost[k]} between {names[k - 1]} and {names[k]}" for k in at[:_MOST_PLACES]]
    more = f" and {len(at) - len(places)} more gaps" if len(at) > len(places) else ""
    count = int(lost.sum())
    return f"{count} image{'s are' if count > 1 else ' is'} missing, {because}: {', '.join(places)}{more}"


def _stem(image: str) -> str:
    name = PurePath(image.replace("\\", "/")).name
    return name if "#" in name else PurePath(name).stem
