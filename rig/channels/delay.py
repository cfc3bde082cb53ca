"""The delay of a channel against the images of a camera, from a light whose voltage is the channel.

The edges of the light in the images and in the channel are the same events. The delay is the time by which
most edges of the channel are later. Each edge lies between two images and between two samples, so many edges
at irregular times give the delay much more exactly than one of them.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rig.channels.edges import Edges
from rig.samples import Floats

LEAST_EDGES = 8
"""Smallest number of edges that give a delay."""
LEAST_SHARE = 0.8
"""Smallest part of the edges in the images that must be found in the channel."""
EARLIEST_S, LATEST_S = -0.1, 10.0
"""A channel cannot be earlier than the light, except by the error of the camera's times. Longer delays than
the second time in s are not accepted in a rig file."""
_MOST_EDGES = 300
"""More edges of the light make the search slow, and the delay hardly more exact."""
_NEAR_S = 0.06
"""Edges belong together if they are this near, in s, after the delay and beyond what both are known to."""
_ALIKE = 0.8
"""Another delay explains the edges as well if it explains this part of the best number."""


@dataclass(frozen=True)
class Delay:
    """The delay of a channel.

    Attributes
    ----------
    delay_s : float
    delay_std_s : float
        Standard deviation of the delay at one moment: its jitter, and the error of `delay_s`.
    mean_std_s : float
        Standard deviation of `delay_s` itself.
    jitter_s : float
        Standard deviation of the delay from edge to edge, without that of locating the edges.
    edges : int
        Number of edges of the light that were found in the channel.
    missing : int
        Number of edges of the light that were not.
    others_s : tuple of float
        Other delays that explain the edges as well, because the light switched regularly.
    """

    delay_s: float
    delay_std_s: float
    mean_std_s: float
    jitter_s: float
    edges: int
    missing: int
    others_s: tuple[float, ...] = ()


def find_delay(light: Edges, signal: Edges, span_s: tuple[float, float]) -> Delay | str:
    """Return the delay of the signal's edges against the light's, or a sentence that says why none is known.

    `span_s` are the times of the first and the last sample of the signal.
    """
    if len(light.time_s) < LEAST_EDGES:
        return (
            f"{len(light.time_s)} edges in the images, and at least {LEAST_EDGES} are needed: switch the "
            "light more often, or film longer with --seconds"
        )
    if len(signal.time_s) < LEAST_EDGES:
        return (
            f"{len(signal.time_s)} edges in the channel, and at least {LEAST_EDGES} are needed: look at the "
            "wire from the light to the channel"
        )
    light = light.within(-math.inf, math.inf, _MOST_EDGES)
    until_s = float(light.time_s[-1]) + LATEST_S
    signal = signal.within(float(light.time_s[0]) + EARLIEST_S, until_s, len(signal.time_s))
    near_s = _NEAR_S + 3.0 * math.hypot(float(light.std_s.mean()), float(signal.std_s.mean()))
    scores = {
        delay_s: _Match(light, signal, delay_s, near_s, span_s) for delay_s in _candidates(light, signal)
    }
    best = max(scores.values(), key=lambda match: match.count, default=None)
    if best is None or best.count < LEAST_EDGES or best.count < LEAST_SHARE * best.possible:
        found = 0 if best is None else best.count
        return (
            f"only {found} of {len(light.time_s)} edges of the light are in the channel at any delay from "
            f"{EARLIEST_S:g} to {LATEST_S:g} s: the channel must show the voltage of the light that the "
            "camera sees"
        )
    alike = [match for match in scores.values() if match.count >= _ALIKE * best.count]
    # Of several delays that fit, the shortest is the most likely one.
    first = min(alike, key=lambda match: match.delay_s)
    chosen = max(
        (match for match in alike if match.delay_s - first.delay_s < near_s), key=lambda match: match.count
    )
    return chosen.refined(_apart([match.delay_s for match in alike], chosen.delay_s, 2.0 * near_s))


def _candidates(light: Edges, signal: Edges) -> Floats:
    """Return the delays at which at least one edge of the light is one of the signal."""
    differences = signal.time_s[None, :] - light.time_s[:, None]
    same = signal.rising[None, :] == light.rising[:, None]
    found = differences[same & (differences >= EARLIEST_S) & (differences <= LATEST_S)]
    # Finer than this, two delays match the same edges.
    return np.unique(np.round(found, 2))


class _Match:
    """The edges of the light and of the signal that belong together at a delay."""

    def __init__(
        self, light: Edges, signal: Edges, delay_s: float, near_s: float, span_s: tuple[float, float]
    ) -> None:
        self._light, self._signal, self._near_s, self._span_s = light, signal, near_s, span_s
        self.delay_s = delay_s
        expected_s = light.time_s + delay_s
        inside = (expected_s >= span_s[0]) & (expected_s <= span_s[1])
        partner, distance_s = _nearest(signal, expected_s, light)
        self._own = np.flatnonzero(inside & (distance_s <= near_s))
        self._partner = partner[self._own]
        self.possible, self.count = int(inside.sum()), len(self._own)

    def refined(self, others_s: tuple[float, ...]) -> Delay:
        """Return the mean delay of the edges, after matching them about it once more."""
        again = self
        for _ in range(2):
            again = _Match(self._light, self._signal, again._mean_s, self._near_s, self._span_s)
        delays_s = again._delays_s
        scatter = float(delays_s.std(ddof=1))
        located = float(np.mean(self._light.std_s[again._own] ** 2 + self._signal.std_s[again._partner] ** 2))
        mean_std_s = scatter / math.sqrt(again.count)
        jitter_s = math.sqrt(max(0.0, scatter**2 - located))
        missing = again.possible - again.count
        std_s = math.hypot(jitter_s, mean_std_s)
        return Delay(again._mean_s, std_s, mean_std_s, jitter_s, again.count, missing, others_s)

    @property
    def _delays_s(self) -> Floats:
        return self._signal.time_s[self._partner] - self._light.time_s[self._own]

    @property
    def _mean_s(self) -> float:
        return float(self._delays_s.mean())


def _nearest(signal: Edges, expected_s: Floats, light: Edges) -> tuple[NDArray[np.intp], Floats]:
    """Return for each edge of the light the nearest one of the signal in the same direction, and how near."""
    distances = np.abs(signal.time_s[None, :] - expected_s[:, None])
    distances[signal.rising[None, :] != light.rising[:, None]] = np.inf
    partner = distances.argmin(axis=1)
    return partner, distances[np.arange(len(expected_s)), partner]


def _apart(delays_s: list[float], chosen_s: float, least_s: float) -> tuple[float, ...]:
    """Return the delays that differ from the chosen one and from each other."""
    found: list[float] = []
    for delay_s in sorted(delays_s):
        if all(abs(delay_s - other_s) > least_s for other_s in (*found, chosen_s)):
            found.append(delay_s)
    return tuple(found)
