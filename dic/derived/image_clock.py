"""The times of images, and what the user knows about the machine's clock."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import inf, isfinite

import numpy as np

from dic.errors import CurveError, is_number, require_all
from dic.gauges.series import GaugeImage
from dic.records.clock import (
    ASSUMED,
    ASSUMED_INTERVALS,
    ASSUMED_RATE_STD,
    FOUND,
    GIVEN,
    MachineClock,
    usual_interval_s,
)
from dic.records.joining import times_of
from dic.records.lost import lost_by_strain, lost_by_time, lost_sentence, places_by_time, places_of
from dic.typing import Float, Indices


@dataclass(frozen=True)
class ImageClock:
    """The times of the images, and the offset and the rate of the machine's clock.

    Without `interval_s` and `times_s`, the times come from the image files.

    Attributes
    ----------
    interval_s : float or None
        Time between two images; the reference image is at 0, the first image after it at `interval_s`. Images
        that are missing in the series count.
    times_s : mapping of str to float, or None
        Times by the images' names, such as from `read_image_times`.
    offset_s : float or None
        Machine's time minus image's time. None if the offset is to be found from strain and load.
    offset_std_s : float or None
        Standard deviation of the offset. Default: an offset of 0 counts as unknown, all offsets up to one
        interval between two images are equally probable; another offset is exact.
    clock_rate : float or None
        Seconds of the machine's clock in one second of the images' clock. None if the rate is to be found
        from strain and load.
    clock_rate_std_percent : float or None
        Standard deviation of the rate, %. Default: a rate of 1 counts as unknown, all errors up to 1 % are
        equally probable; another rate is exact.

    Raises
    ------
    CurveError
        If a value is impossible, or two contradict each other.
    """

    interval_s: float | None = None
    times_s: Mapping[str, float] | None = None
    offset_s: float | None = 0.0
    offset_std_s: float | None = None
    clock_rate: float | None = 1.0
    clock_rate_std_percent: float | None = None

    def __post_init__(self) -> None:
        given = self.interval_s
        if given is not None and self.times_s is not None:
            expected, remedy = (
                "an interval or a table of times",
                "leave out --image-interval-s or --image-times",
            )
            raise CurveError("settings", "image times", expected, "both", remedy)
        checks = [
            (given is None or _between(given, 1e-9, 1e9), "--image-interval-s",
             "a number of seconds above 0", given, "give --image-interval-s 0.5"),
            (self.offset_s is None or _between(self.offset_s, -inf, inf), "--offset-s",
             "a number of seconds", self.offset_s, "give --offset-s 0"),
            (_is_std(self.offset_std_s, self.offset_s, 1e9), "--offset-std-s",
             "at least 0 s, beside a number for --offset-s", self.offset_std_s, "correct or leave it out"),
            (self.clock_rate is None or _between(self.clock_rate, 0.5, 2.0), "--clock-rate",
             "between 0.5 and 2", self.clock_rate, "give --clock-rate 1"),
            (_is_std(self.clock_rate_std_percent, self.clock_rate, 10.0), "--clock-rate-std-percent",
             "from 0 % to 10 %, beside a number for --clock-rate", self.clock_rate_std_percent,
             "correct or leave it out"),
        ]  # fmt: skip
        require_all(CurveError, "settings", checks)

    def of(self, images: Sequence[GaugeImage], reference: str = "") -> tuple[Float, str]:
        """Return the time of each image in seconds, shape (images,), and the source of the times.

        The sources are tried in this order: "table" (`times_s`), "interval" (`interval_s`), and the times
        that the images have themselves, "video", "exif" or "file". `reference`: the name of the reference
        image; its number counts with an interval.

        Raises
        ------
        CurveError
            If an image has no time, or the images' own times come from different sources or are equal.
        """
        labels = [image.label for image in images]
        if self.times_s is not None:
            return times_of(labels, self.times_s, "image times"), "table"
        if self.interval_s is None:
            return _own_times(images)
        places, first = places_of([reference, *labels]), 0
        if places is None:
            places, first = places_of(labels), 1
        if not _skipped(places).any():
            # The numbers show no gap, but the images' own times may.
            places, first = None, 1
            sources = {str(image.known.get("time_source", "")) for image in images}
            if len(sources) == 1 and "" not in sources:
                own = np.array([float(image.known["time_s"]) for image in images])
                places = places_by_time(own, self.interval_s)
        places = np.arange(len(labels)) if places is None else places[-len(labels) :]
        return np.asarray(self.interval_s * (first + places), np.float64), "interval"

    def lost(
        self, images: Sequence[GaugeImage], times_s: Float, strain: Float | None, reference: str = ""
    ) -> str:
        """Return a sentence about images that are missing in the series; "" if none are.

        `times_s`, `reference`: the result and the argument of `of`. `strain`, shape (images,): the strain
        along the specimen; None if it is not known.
        """
        labels = [image.label for image in images]
        names = [reference, *labels]
        if (by_number := places_of(names)) is None:
            names, by_number = labels, places_of(labels)
        if _skipped(by_number).any():
            return lost_sentence(names, _skipped(by_number), "as the numbers in the file names show")
        if self.interval_s is None:
            lost = lost_by_time(times_s)
        else:
            lost = _skipped(np.round(times_s / self.interval_s).astype(np.int64))
        if lost.any() or self.interval_s is None or strain is None:
            return lost_sentence(labels, lost, "as the times of the images show")
        return lost_sentence(labels, lost_by_strain(strain), "as jumps of the strain suggest")

    def machine_clock(self, times_s: Float) -> MachineClock:
        """Return what is known about the machine's clock before strain and load are compared.

        `times_s`, shape (images,): the times of the images. An infinite standard deviation means that the
        value is to be found.
        """
        percent = self.clock_rate_std_percent
        share = None if percent is None else percent / 100.0
        known = (self.offset_s, self.offset_std_s, 0.0), (self.clock_rate, share, 1.0)
        interval_s = usual_interval_s(times_s)
        unknown = (ASSUMED_INTERVALS * interval_s if isfinite(interval_s) else 0.0), ASSUMED_RATE_STD
        (offset_s, offset_std_s, offset_from), (rate, rate_std, rate_from) = (
            (usual, inf, FOUND) if value is None
            else (value, assumed, ASSUMED) if std is None and value == usual
            else (value, std or 0.0, GIVEN)
            for (value, std, usual), assumed in zip(known, unknown, strict=True)
        )  # fmt: skip
        return MachineClock(offset_s, offset_std_s, rate, rate_std, 0.0, offset_from, rate_from)


def _between(value: float, low: float, high: float) -> bool:
    return is_number(value) and isfinite(value) and low <= value <= high


def _is_std(std: float | None, value: float | None, most: float) -> bool:
    """Return True if a standard deviation is possible; a value that is to be found has none."""
    return std is None or (value is not None and _between(std, 0.0, most))


def _skipped(places: Indices | None) -> Indices:
    """Return the number of places before each image at which there is no image."""
    return np.zeros(0, np.int64) if places is None else np.diff(places, prepend=places[0] - 1) - 1


def _own_times(images: Sequence[GaugeImage]) -> tuple[Float, str]:
    """Return the times that the images have themselves, and their source."""
    sources = {str(image.known.get("time_source", "")) for image in images}
    remedy = "give --image-interval-s, or --image-times with a table"
    if len(sources) != 1 or "" in sources:
        named = [f"times from {name}" if name else "images without" for name in sorted(sources)]
        got = "none" if sources <= {""} else " and ".join(named)
        raise CurveError("settings", "join by time", "times of all images from one source", got, remedy)
    times, source = np.array([float(image.known["time_s"]) for image in images]), sources.pop()
    equal = np.flatnonzero(np.diff(times) == 0.0)
    if equal.size:
        # Exif tags without a fraction of a second, and videos without times of frames, give equal times.
        pair = f"{images[equal[0]].label} and {images[equal[0] + 1].label}"
        expected, got = "a time of its own for each image", f"{times[equal[0]]:g} s for both {pair}"
        raise CurveError(f"times from {source}", "join by time", expected, got, remedy)
    return times, source
