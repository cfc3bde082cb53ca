"""How well the images of a run kept the times at which they were due."""

import math
import tomllib
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from dic.runfile.steps import RunStep
from dic.typing import Float, Indices

TOLERANCE_S, TOLERANCE_SHARE = 0.5, 0.5
"""An image is late by more than the smaller one of both, if the protocol states no tolerance: a time, and a
share of the interval that was asked for."""
_EVEN = 0.02
"""Due times have a fixed interval if they differ from its multiples by at most this share of it, and most of
them follow each other at once.
"""


@dataclass(frozen=True)
class ImageTiming:
    """The lateness of a camera's images, and the rate that was asked for and reached.

    Attributes
    ----------
    images : int
        Number of the images that were due at a time.
    asked_interval_s : float or None
        Time that was asked for between two images; None without a fixed one.
    reached_interval_s : float or None
        Median of the time between two images; None for fewer than two.
    late_s, latest_s : float
        Time from the due time to the middle of the exposure: its median and its largest value.
    tolerance_s : float
    late : int
        Number of the images that were later than `tolerance_s`.
    missing : int or None
        Number of the images that were due between others and were not taken; None without a fixed interval.
    """

    images: int
    asked_interval_s: float | None
    reached_interval_s: float | None
    late_s: float
    latest_s: float
    tolerance_s: float
    late: int
    missing: int | None

    @classmethod
    def of(cls, steps: Sequence[RunStep], definition: str = "") -> "ImageTiming | None":
        """Return the timing of the steps that a camera measured; None if no image was due at a time.

        `definition`: the text of the run's protocol, which may state an interval and a tolerance.
        """
        timed = [step for step in steps if math.isfinite(step.late_s)]
        if not timed:
            return None
        declared = _declared(definition)
        due_s, number = np.array([step.due_s for step in timed]), np.array([step.index for step in timed])
        late_s = np.array([step.late_s for step in timed])
        # Between two series of images other steps were executed, whose time misses no image.
        series = np.cumsum([not math.isfinite(step.late_s) for step in steps])
        inside = np.diff(series[[math.isfinite(step.late_s) for step in steps]]) == 0
        asked_s = declared.get("every_s") or _interval_s(due_s, number)
        tolerance_s = declared.get("tolerance_s")
        if tolerance_s is None:
            tolerance_s = TOLERANCE_S if asked_s is None else min(TOLERANCE_S, TOLERANCE_SHARE * asked_s)
        reached_s = np.diff([step.time_s for step in timed]) / np.diff(number)
        missing = None
        if asked_s is not None:
            left_out = np.round(np.diff(due_s) / asked_s) - np.diff(number)
            missing = int(np.maximum(left_out[inside], 0.0).sum())
        return cls(
            len(timed),
            asked_s,
            float(np.median(reached_s)) if len(reached_s) else None,
            float(np.median(late_s)),
            float(late_s.max()),
            tolerance_s,
            int(np.count_nonzero(late_s > tolerance_s)),
            missing,
        )

    @property
    def is_late(self) -> bool:
        """True if an image was late or is missing."""
        return bool(self.late or self.missing)

    @property
    def sentences(self) -> list[str]:
        """The timing in words: the rate if it is known, and the lateness."""
        asked_s, reached_s = self.asked_interval_s, self.reached_interval_s
        rate = [f"asked every {asked_s:.4g} s"] if asked_s is not None else []
        rate += [f"reached every {reached_s:.4g} s in the median"] if reached_s is not None else []
        late = f"{self.late} of {self.images} more than {self.tolerance_s:.3g} s late"
        late += f" (median {self.late_s:.3g} s, latest {self.latest_s:.3g} s)"
        late += f", {self.missing} missing" if self.missing is not None else ""
        return [f"images {', '.join(rate)}"] * bool(rate) + [f"timed images: {late}"]

    @property
    def text(self) -> str:
        """The timing as one sentence."""
        return "; ".join(self.sentences)

    def as_dict(self) -> dict[str, Any]:
        """Return everything for JSON."""
        return asdict(self)


def _declared(definition: str) -> dict[str, float]:
    """Return interval and tolerance that a protocol states for an acquisition."""
    try:
        table = tomllib.loads(definition).get("acquire", {})
    except (tomllib.TOMLDecodeError, RecursionError):
        return {}
    found = table if isinstance(table, dict) else {}
    stated = {name: found.get(name) for name in ("every_s", "tolerance_s")}
    return {
        name: float(value) for name, value in stated.items() if isinstance(value, int | float) and value > 0.0
    }


def _interval_s(due_s: Float, number: Indices) -> float | None:
    """Return the fixed interval of due times; None if they have none."""
    steps = np.diff(due_s)[np.diff(number) == 1]
    if not len(steps) or not (steps > 0.0).all():
        return None
    shortest = float(steps.min())
    multiples = steps / shortest
    even = (np.abs(multiples - np.round(multiples)) <= _EVEN).all() and round(np.median(multiples)) == 1
    return shortest if even else None
