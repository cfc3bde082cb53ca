"""The delay of a channel against a camera, from a line whose edges are the beginnings of exposures.

The line is an output of the camera that is active during each exposure, or the trigger of a triggered camera.
An edge of the line lies somewhere between two samples of the channel. If the frames and the samples both come
at equal times, it lies at the same place between two samples again and again, and the mean of many edges is
not better known than one of them. So the mean delay is estimated from the intervals themselves: which delays,
with which jitter, let each edge be where it was seen. The errors of the times of regular frames would make
equal places look different, so these times are replaced by those of a straight line.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from rig.channels.delay import LATEST_S, LEAST_EDGES, LEAST_SHARE, Delay
from rig.channels.edges import LEAST_CONTRAST, levels_of, switches
from rig.samples import Floats

EARLIEST_S, _PUNCTUAL_S = -0.05, -0.005
"""A channel is earlier than the line only by the error of the camera's times. If several delays fit, one that
is earlier than the second time in s is the least likely."""
_REGULAR = 0.1
"""Frames are regular if their times scatter about a straight line by less than this part of an interval."""
_NEAR_S = 0.1
"""Edges belong together if they are at most this much apart, in s, after the delay."""
_NEAR_SHARE = 0.45
"""The same as a part of the shortest time between two edges: farther apart, the next one is nearer."""
_ALIKE = 0.8
"""Another delay explains the edges as well if it explains this part of the best number."""
_LEAST_COUNTS = 4
_DELAYS, _JITTERS, _REFINEMENTS = 101, 32, 3
"""Numbers of delays and of jitters that are compared, and how often again about the best ones."""
_SAME = 0.5
"""Above this sameness of the places of all edges between two samples, no distribution is assumed."""
_LEAST_ERROR = 0.25
"""Least error of the mean of middles, as a part of that for equal delays. Delays that scatter by a third of
an interval leave an error of this size, or of 0, depending on their distribution."""
_LEAST_LIKELY = 1e-9
"""Probability of an edge that no delay explains, so that one wrong edge does not decide."""


@dataclass(frozen=True)
class LineEdges:
    """Edges of a line, the earliest first. Each lies between `before_s` and `after_s`, shapes (n,)."""

    before_s: Floats
    after_s: Floats

    @property
    def middle_s(self) -> Floats:
        """Middles of the intervals."""
        return (self.before_s + self.after_s) / 2


def edges_of_line(time_s: Floats, values: Floats, *, rising: bool) -> LineEdges | None:
    """Return the edges of a line in one direction, from its level or from a counter of its pulses.

    Return None if the values neither switch between two levels nor count.
    """
    counts = np.diff(values)
    if len(np.unique(values)) >= _LEAST_COUNTS and (values == np.round(values)).all() and (counts >= 0).all():
        # if two pulses came between two samples, nothing tells when
        at = np.flatnonzero(counts == 1)
        return LineEdges(time_s[at], time_s[at + 1])
    levels = levels_of(values)
    if levels.contrast < LEAST_CONTRAST:
        return None
    found = [(last, first) for last, first, rises in switches(levels.share(values)) if rises == rising]
    last, first = np.array(found, np.intp).reshape(-1, 2).T
    return LineEdges(time_s[last], time_s[first])


def find_line_delay(begins_s: Floats, line: LineEdges, span_s: tuple[float, float]) -> Delay | str:
    """Return the delay of a line's edges against the beginnings of exposures, or why none is known.

    `begins_s` has the beginnings as the camera's driver tells them, rising, `span_s` the times of the first
    and the last sample of the channel.
    """
    for count, what in ((len(begins_s), "exposures"), (len(line.before_s), "edges in the channel")):
        if count < LEAST_EDGES:
            return f"{count} {what}, and at least {LEAST_EDGES} are needed: film longer with --seconds"
    begins_s, error_s = straightened(begins_s)
    near_s = min(_NEAR_S, _NEAR_SHARE * min(_shortest_s(begins_s), _shortest_s(line.middle_s)))
    alike = _alike(begins_s, line, near_s, span_s)
    if not alike:
        return _NOT_FOUND.format(len(begins_s))
    # Of several delays that fit, the shortest is the most likely one.
    delay_s = min(alike, key=lambda each: (each < _PUNCTUAL_S, abs(each)))
    match = _Match(begins_s, line, delay_s, near_s, span_s)
    for _ in range(2):
        match = _Match(begins_s, line, match.middle_s, near_s, span_s)
    if match.count < LEAST_EDGES or match.count < LEAST_SHARE * match.possible:
        return _NOT_FOUND.format(len(begins_s))
    mean_s, mean_std_s, jitter_s = estimated(match.low_s, match.high_s)
    # the error of the straight line at its ends, and that of the time of one frame
    mean_std_s = math.hypot(mean_std_s, 2.0 * error_s / math.sqrt(len(begins_s)))
    jitter_s = math.hypot(jitter_s, error_s)
    others_s = tuple(other_s for other_s in sorted(alike) if abs(other_s - mean_s) > near_s)
    missing = match.possible - match.count
    std_s = math.hypot(jitter_s, mean_std_s)
    return Delay(mean_s, std_s, mean_std_s, jitter_s, match.count, missing, others_s)


def straightened(times_s: Floats) -> tuple[Floats, float]:
    """Return the times of regular frames without the scatter about a straight line, and the scatter in s.

    Times of other frames are returned as they are, and 0.
    """
    interval_s = float(np.median(np.diff(times_s)))
    numbers = np.cumsum(np.round(np.diff(times_s, prepend=times_s[0]) / interval_s))
    line = np.polynomial.Polynomial.fit(numbers, times_s, 1)(numbers)
    scatter_s = float((times_s - line).std(ddof=2))
    return (line, scatter_s) if scatter_s < _REGULAR * interval_s else (times_s, 0.0)


def estimated(low_s: Floats, high_s: Floats) -> tuple[float, float, float]:
    """Return the mean of delays that lie in intervals, its standard deviation, and that of the delays.

    If the edges lie at ever the same place between two samples, the distribution of the delays decides where
    their mean is, and nobody knows it. Then the mean of the middles of the intervals is taken. It is wrong by
    at most half an interval if the delays are equal, and by less if they scatter.
    """
    mean_s, std_s, jitter_s = _most_likely(low_s, high_s)
    width_s = float(np.median(high_s - low_s))
    # 1 if all edges lie at the same place between two samples, 0 if at all places
    sameness = float(abs(np.exp(2j * np.pi * (mean_s - low_s) / (high_s - low_s)).mean()))
    sameness = math.sqrt(max(0.0, sameness**2 - 1.0 / len(low_s)))
    if sameness > _SAME:
        middles_s = (low_s + high_s) / 2
        mean_s, std_s = float(middles_s.mean()), float(middles_s.std(ddof=1)) / math.sqrt(len(low_s))
    scattered = max(_LEAST_ERROR, math.exp(-2.0 * (math.pi * jitter_s / width_s) ** 2))
    return mean_s, math.hypot(std_s, sameness * scattered * width_s / math.sqrt(12.0)), jitter_s


def _most_likely(low_s: Floats, high_s: Floats) -> tuple[float, float, float]:
    """Return the same for delays that are normally distributed about their mean.

    The mean and the order of magnitude of the jitter have no preferred value.
    """
    width_s = float(np.median(high_s - low_s))
    middles_s = (low_s + high_s) / 2
    scatter_s = float(middles_s.std())
    centre_s, reach_s = float(middles_s.mean()), width_s + 6.0 * scatter_s / math.sqrt(len(low_s))
    jitters_s = np.geomspace(width_s / 200, max(4.0 * scatter_s, 2.0 * width_s), _JITTERS)
    mean_s = std_s = jitter_s = math.nan
    for _ in range(_REFINEMENTS):
        delays_s = np.linspace(centre_s - reach_s, centre_s + reach_s, _DELAYS)
        weights = _likelihood(delays_s, jitters_s, low_s, high_s)
        weights /= weights.sum()
        of_delay = weights.sum(axis=1)
        mean_s = float(of_delay @ delays_s)
        step_s = float(delays_s[1] - delays_s[0])
        # the delays between those that are compared count too
        std_s = math.sqrt(float(of_delay @ (delays_s - mean_s) ** 2) + step_s**2 / 12.0)
        jitter_s = float(weights.sum(axis=0) @ jitters_s)
        centre_s, reach_s = mean_s, 6.0 * std_s
    return mean_s, std_s, jitter_s


def _likelihood(delays_s: Floats, jitters_s: Floats, low_s: Floats, high_s: Floats) -> Floats:
    """Return the likelihood of each delay and jitter, shape (delays, jitters), up to a factor."""
    sums = np.empty((len(delays_s), len(jitters_s)))
    for k, jitter_s in enumerate(jitters_s.tolist()):
        above = (high_s[None, :] - delays_s[:, None]) / jitter_s
        below = (low_s[None, :] - delays_s[:, None]) / jitter_s
        sums[:, k] = np.log(np.maximum(ndtr(above) - ndtr(below), _LEAST_LIKELY)).sum(axis=1)
    found: Floats = np.exp(sums - sums.max())
    return found


class _Match:
    """The beginnings of exposures and the edges that belong together at a delay."""

    def __init__(
        self, begins_s: Floats, line: LineEdges, delay_s: float, near_s: float, span_s: tuple[float, float]
    ) -> None:
        expected_s = begins_s + delay_s
        inside = (expected_s >= span_s[0] + near_s) & (expected_s <= span_s[1] - near_s)
        partner = _nearest(line.middle_s, expected_s)
        own = np.flatnonzero(inside & (np.abs(line.middle_s[partner] - expected_s) <= near_s))
        self.low_s = line.before_s[partner[own]] - begins_s[own]
        self.high_s = line.after_s[partner[own]] - begins_s[own]
        self.possible, self.count = int(inside.sum()), len(own)
        middles_s = (self.low_s + self.high_s) / 2
        self.middle_s = float(middles_s.mean()) if len(own) else delay_s
        self.scatter_s = float(middles_s.std()) if len(own) else math.inf


def _alike(begins_s: Floats, line: LineEdges, near_s: float, span_s: tuple[float, float]) -> list[float]:
    """Return the delays, rising, at which about as many edges are found as at the best one."""
    step_s = near_s / 2
    differences = line.middle_s[None, :] - begins_s[:, None]
    inside = differences[(differences >= EARLIEST_S - step_s) & (differences <= LATEST_S)]
    candidates_s = np.unique(np.round(inside / step_s)) * step_s
    found = {}
    for candidate_s in candidates_s.tolist():
        match = _Match(begins_s, line, candidate_s, near_s, span_s)
        if match.count >= max(LEAST_EDGES, LEAST_SHARE * match.possible):
            # about their mean, the same edges may be found again
            found[candidate_s] = _Match(begins_s, line, match.middle_s, near_s, span_s)
    best = max((match.count for match in found.values()), default=0)
    chosen = sorted(
        (match.middle_s, match.scatter_s)
        for match in found.values()
        if match.count >= _ALIKE * best and match.middle_s >= EARLIEST_S
    )
    groups: list[tuple[float, float]] = []
    for middle_s, scatter_s in chosen:
        if groups and middle_s - groups[-1][0] < near_s:
            groups[-1] = min(groups[-1], (middle_s, scatter_s), key=lambda each: each[1])
        else:
            groups.append((middle_s, scatter_s))
    return [middle_s for middle_s, _ in groups]


def _nearest(times_s: Floats, expected_s: Floats) -> NDArray[np.intp]:
    """Return for each expected time the number of the nearest time. Both rise."""
    after = np.clip(np.searchsorted(times_s, expected_s), 1, len(times_s) - 1)
    return after - (expected_s - times_s[after - 1] < times_s[after] - expected_s)


def _shortest_s(times_s: Floats) -> float:
    return float(np.diff(times_s).min(initial=math.inf))


_NOT_FOUND = (
    f"only a part of the {{}} exposures is in the channel at any delay from {EARLIEST_S:g} to {LATEST_S:g} "
    "s: pulses that are shorter than the time between two samples are missed, so read faster, make the "
    "exposure longer, or count the pulses with a counter input; and look at the wire, and at the direction "
    "of --line"
)
