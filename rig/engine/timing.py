"""How well the images of an acquisition kept their times."""

import math
from array import array
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

_RECENT = 20
_COUNTED = ("asked", "taken", "late", "missing", "paused")


@dataclass(frozen=True)
class TimingNow:
    """A snapshot of an acquisition for the screen and for other programs.

    Attributes
    ----------
    asked, taken, late, missing : int
        As for `Timing`.
    planned : int or None
        Number of images of each camera in all; None if events decide it.
    interval_s, reached_s : float
        Time between two images: asked for, and the median of the newest ones. NaN if there is none.
    waits_for : str
        The event that begins the images, or an empty text once they have begun.
    on_request : bool
        True if the operator asks for each image.
    """

    asked: int
    taken: int
    late: int
    missing: int
    planned: int | None
    interval_s: float
    reached_s: float
    waits_for: str = ""
    on_request: bool = False


@dataclass
class Timing:
    """The number of images that were asked for, taken, late and missing, and the rate that was reached.

    Attributes
    ----------
    interval_s : float
        Time that was asked for between two images, NaN without a fixed one.
    tolerance_s : float
        An image whose exposure is farther than this from its due time is late.
    planned : int or None
        Number of images in all; None if events decide it.
    asked, taken, late, missing : int
    paused : int
        Number of images that were not asked for, because the run was paused at their times.
    first_s : float
        Middle of the exposure of the first image, on the rig's clock.
    causes : dict of str to str
        Why images of a camera are missing, as far as it is known.
    """

    interval_s: float = math.nan
    tolerance_s: float = math.inf
    planned: int | None = None
    asked: int = 0
    taken: int = 0
    late: int = 0
    missing: int = 0
    paused: int = 0
    first_s: float = math.nan
    causes: dict[str, str] = field(default_factory=dict)
    _last_s: float = math.nan
    _latest_s: float = 0.0
    _intervals_s: "array[float]" = field(default_factory=lambda: array("d"))

    @classmethod
    def together(cls, parts: "Sequence[Timing]") -> "Timing | None":
        """Return the sums of several acquisitions, with the settings of the last one; None without images."""
        if not any(part.asked for part in parts):
            return None
        sums = {name: sum(getattr(part, name) for part in parts) for name in _COUNTED}
        intervals_s = array("d", [each for part in parts for each in part._intervals_s])
        latest_s = max(part._latest_s for part in parts)
        return replace(parts[-1], **sums, _intervals_s=intervals_s, _latest_s=latest_s)

    def ask(self) -> None:
        """Count an image that is asked for."""
        self.asked += 1

    def miss(self) -> None:
        """Count an image that was asked for and cannot be taken."""
        self.missing += 1

    def lose(self, count: int) -> None:
        """Count images that a camera took and nobody got."""
        self.asked += count
        self.missing += count

    def take(self, due_s: float, middle_s: float) -> int:
        """Count an image by its due time and the middle of its exposure. Return its number from 0."""
        if self.taken == 0:
            self.first_s = middle_s
        else:
            self._intervals_s.append(middle_s - self._last_s)
        self._last_s = middle_s
        off_s = abs(middle_s - due_s)
        self._latest_s = max(self._latest_s, off_s)
        self.late += off_s > self.tolerance_s
        self.taken += 1
        return self.taken - 1

    @property
    def is_late(self) -> bool:
        """True if an image was late or is missing."""
        return bool(self.late or self.missing)

    @property
    def reached_s(self) -> float:
        """Median of the time between two images, NaN without two."""
        return _median(self._intervals_s)

    def now(self, waits_for: str, *, on_request: bool) -> TimingNow:
        """Return the present numbers."""
        return TimingNow(
            self.asked,
            self.taken,
            self.late,
            self.missing,
            self.planned,
            self.interval_s,
            _median(self._intervals_s[-_RECENT:]),
            waits_for,
            on_request,
        )

    def sentences(self) -> list[str]:
        """Return what the run file and the operator are told at the end."""
        found = [f"{self.taken} of {self.asked} images taken"]
        if not math.isnan(self.interval_s):
            found[0] += f", every {self.reached_s:.4g} s in the median, {self.interval_s:g} s was asked for"
        if self.paused:
            found[0] += f"; {self.paused} fell into pauses"
        if self.is_late:
            found.append(
                f"{self.late} images were more than {self.tolerance_s:g} s off their times (the worst by "
                f"{self._latest_s:.3g} s), {self.missing} are missing: each image has its true time; take "
                "them less often, use a faster camera or computer, or raise acquire.tolerance_s"
            )
        return found + list(self.causes.values())

    def as_dict(self) -> dict[str, float | int | None]:
        """Return the numbers for JSON."""
        return {
            "asked": self.asked,
            "taken": self.taken,
            "late": self.late,
            "missing": self.missing,
            "paused": self.paused,
            "latest_s": self._latest_s,
            "tolerance_s": self.tolerance_s,
            "asked_interval_s": None if math.isnan(self.interval_s) else self.interval_s,
            "reached_interval_s": None if math.isnan(self.reached_s) else self.reached_s,
        }


def _median(values_s: "array[float]") -> float:
    return float(np.median(values_s)) if values_s else math.nan
