"""Reads one gauge in the fields of each frame, and judges its value."""

import numpy as np
from numpy.typing import NDArray

from dic.correlation.status import Status
from dic.gauges.declared import Gauge, Placed, Prepared
from dic.gauges.field import GaugeField
from dic.gauges.reading import Profile, Reading
from dic.live.points import GaugePoints
from dic.live.reasons import Reason
from dic.live.settings import LiveSettings
from dic.live.tiles import tiles_of
from dic.typing import Indices, Mask

_KEPT = 4
"""Number of sets of points for which the sums of a gauge are kept."""

_NOISE = 6.0
"""Changes by less than this many standard deviations of the noise are always credible."""


class FollowedGauge:
    """A gauge, its points, and the sums that its readings need.

    `gauge`, `placed`: the gauge and its points. `points`: the points of all gauges of the camera.
    `radius_px`: number of pixels of a subset on either side of its point.

    `numbers`: numbers of the gauge's points among those of the camera.
    """

    def __init__(
        self, gauge: Gauge, placed: Placed, points: GaugePoints, radius_px: int, settings: LiveSettings
    ) -> None:
        self.gauge, self._placed, self._settings = gauge, placed, settings
        places = set(zip(*(each.tolist() for each in placed.points()), strict=True))
        self.numbers: Indices = np.array(sorted(points.numbers[place] for place in places))
        at = points.points[self.numbers]
        groups = tiles_of(np.stack([points.x[at], points.y[at]], axis=1), radius_px, 0)
        self.groups = [self.numbers[own] for own in groups]
        """The points of each patch of the gauge, numbered as `numbers`."""
        self._prepared: dict[tuple[str, bytes], Prepared] = {}
        self._jumps = _Jumps(settings)

    def read(self, kind: str, field: GaugeField, valid: Mask) -> Reading | Profile:
        """Return the reading of a kind in its field; `valid`, shape (n,), tells the points that have one."""
        key = kind, valid[self.numbers].tobytes()
        if key not in self._prepared:
            while len(self._prepared) >= 3 * _KEPT:
                del self._prepared[next(iter(self._prepared))]
            self._prepared[key] = self._placed.prepared(field.displacement, often=True)
        return self._prepared[key].read(field)

    def forget(self, kind: str) -> None:
        """Forget the sums of a kind, because its points have other positions from now on."""
        self._prepared = {key: each for key, each in self._prepared.items() if key[0] != kind}

    def objection(
        self, valid: Mask, status: NDArray[np.int8], reading: Reading | Profile, time_s: float
    ) -> tuple[Reason, str]:
        """Return why the raw value of a frame is not valid, and figures; `Reason.NONE` and "" if it is.

        `valid`, `status`, shape (n,): which points have a displacement, and the status of each point.
        """
        own = valid[self.numbers]
        share = np.count_nonzero(own) / len(own)
        if share < self._settings.least_share or reading.reason:
            return _loss(status[self.numbers][~own]), f"{np.count_nonzero(own)} of {len(own)} points"
        if isinstance(reading, Reading):
            return self._jumps.objection(reading, time_s)
        return Reason.NONE, ""


def _loss(status: NDArray[np.int8]) -> Reason:
    """Return the reason that most of the lost points have."""
    if not status.size:
        return Reason.POINTS_LOST
    outside = np.isin(status, (Status.OUT_OF_VIEW, Status.CONVERGED))
    poor = np.isin(status, (Status.LOW_CORRELATION, Status.NO_TEXTURE, Status.NOT_CONVERGED))
    counts = {Reason.OUTSIDE: outside.sum(), Reason.LOW_CORRELATION: poor.sum()}
    reason = max(counts, key=lambda each: int(counts[each]))
    return reason if 2 * counts[reason] > status.size else Reason.POINTS_LOST


class _Jumps:
    """Tells changes of a strain that are too fast to be credible."""

    def __init__(self, settings: LiveSettings) -> None:
        self._settings = settings
        self._last: tuple[float, float] | None = None
        self._since: list[tuple[float, float]] = []

    def objection(self, reading: Reading, time_s: float) -> tuple[Reason, str]:
        """Return `Reason.JUMP` and figures if the strain has jumped since the last valid one."""
        std = 0.0 if np.isnan(reading.strain_std_images) else reading.strain_std_images
        here = time_s, reading.strain
        if self._last is None or self._credible(self._last, here, std):
            self._last, self._since = here, []
            return Reason.NONE, ""
        if self._since and not self._credible(self._since[-1], here, std):
            self._since = []
        self._since.append(here)
        text = f"from {100 * self._last[1]:.3f} % to {100 * here[1]:.3f} % in {here[0] - self._last[0]:.3f} s"
        if len(self._since) < self._settings.confirming_frames:
            return Reason.JUMP, text
        self._last, self._since = here, []
        return Reason.NONE, ""

    def _credible(self, before: tuple[float, float], after: tuple[float, float], std: float) -> bool:
        limit = self._settings.most_strain_per_s * abs(after[0] - before[0]) + _NOISE * np.sqrt(2.0) * std
        return bool(abs(after[1] - before[1]) <= limit)
