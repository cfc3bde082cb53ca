"""The values of all gauges in one frame of a camera, each with the word whether it may be used."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from dic.gauges.reading import Profile, Reading
from dic.gauges.series import KINDS
from dic.live.reasons import Reason


class LiveValue(NamedTuple):
    """The strain of a gauge in one frame."""

    strain: float
    """Engineering strain; NaN if there is none."""
    std: float
    """Its standard deviation."""
    valid: bool
    """True if the value may be used for limits and control."""
    reason: Reason
    """Why it may not."""
    kind: str
    """The kind of the strain: "raw", "calibrated" or "corrected"."""


@dataclass(frozen=True)
class LiveGauge:
    """The readings of one gauge in one frame.

    Attributes
    ----------
    name : str
    readings : mapping of str to (Reading or Profile)
        The readings, as those of the offline measurement, keyed by "raw", "calibrated" and "corrected".
    reason : Reason
        Why no reading of the frame is valid; `Reason.NONE` if they are.
    unusable : mapping of str to Reason
        Why a kind of reading is not valid although the frame is.
    figures : str
        Figures for the reason, such as how many points are left; "" if there are none.
    """

    name: str
    readings: Mapping[str, Reading | Profile]
    reason: Reason
    unusable: Mapping[str, Reason]
    figures: str = ""

    def reason_of(self, kind: str) -> Reason:
        """Return why the reading of a kind is not valid; `Reason.NONE` if it is."""
        missing = Reason.NONE if kind in self.readings else Reason.NO_VALUE
        return self.reason or self.unusable.get(kind, missing)

    def value(self, kind: str | None = None) -> LiveValue:
        """Return the strain of a kind; default: the best that the camera can give, valid or not.

        A line cut has no strain; its value is NaN.
        """
        expected = kind or next(each for each in KINDS if each in self.readings or each in self.unusable)
        reading, reason = self.readings.get(expected), self.reason_of(expected)
        if not isinstance(reading, Reading):
            return LiveValue(np.nan, np.nan, not reason and reading is not None, reason, expected)
        return LiveValue(reading.strain, reading.strain_std, not reason, reason, expected)


@dataclass(frozen=True)
class LiveImage:
    """The readings of all gauges in one frame of one camera.

    Attributes
    ----------
    time_s : float
    gauges : mapping of str to LiveGauge
        Keyed by the gauge's name.
    reason : Reason
        Why no gauge of the frame is valid, such as `Reason.REPEATED`.
    age_s : float
        Age of the motion out of the plane that corrected strain uses; NaN if there is none.
    lost : int
        Number of groups of points that are lost and searched.
    """

    time_s: float
    gauges: Mapping[str, LiveGauge]
    reason: Reason = Reason.NONE
    age_s: float = float("nan")
    lost: int = 0

    def __repr__(self) -> str:
        values = {name: gauge.value() for name, gauge in self.gauges.items()}
        texts = (
            f"{name} {1e6 * v.strain:z.0f} ± {1e6 * v.std:.0f} µε"
            + (f" ({v.reason.value})" if v.reason else "")
            for name, v in values.items()
        )
        return f"LiveImage({self.time_s:.3f} s, {', '.join(texts)})"

    def __getitem__(self, name: str) -> LiveGauge:
        return self.gauges[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self.gauges)
