"""Join the record of a testing machine to images: by the images' names, by rows, or by time."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import PurePath

import numpy as np

from dic.errors import CurveError
from dic.records.clock import ASSUMED, FOUND, GIVEN, MachineClock, clock_errors_n, usual_interval_s
from dic.records.machine import MachineRecord
from dic.records.offset import find_clock
from dic.typing import Float

JOINS = ("name", "row", "time")
_IMAGE_TIMES = {
    "video": " of the video's frames",
    "exif": " of the images' Exif tags",
    "file": " of the image files' last change, which is late by the time of writing",
}
_FROM = {
    ASSUMED: ", assumed because nobody gave {}",
    FOUND: ", found from load and strain",
    GIVEN: "",
}


@dataclass(frozen=True)
class JoinedRecord:
    """The readings of a testing machine at each image.

    Attributes
    ----------
    load_n : ndarray, shape (images,)
    displacement_mm, time_s : ndarray, shape (images,), or None
        Displacement, and time on the machine's clock; None if the record has none.
    join : str
        How the record was joined to the images: "name", "row" or "time".
    offset_s, offset_std_s : float or None
        Machine's time minus image's time at the first image, and its standard deviation; None if the record
        was not joined by time.
    image_times : str
        Where the images' times come from: "table", "interval", "video", "exif" or "file"; "" if the record
        was not joined by time.
    clock : MachineClock or None
        Offset and rate of the machine's clock, their covariance, and where they come from.
    errors_n : ndarray, shape (images, 2), or None
        Change of each load if the offset, or the rate, is larger by one standard deviation.
    lost : str
        A sentence about images that are missing in the series; "" if none are.
    """

    load_n: Float
    displacement_mm: Float | None
    time_s: Float | None
    join: str
    offset_s: float | None = None
    offset_std_s: float | None = None
    image_times: str = ""
    clock: MachineClock | None = None
    errors_n: Float | None = None
    lost: str = ""

    @property
    def text(self) -> str:
        """How the record was joined to the images, in words."""
        if self.offset_s is None:
            return f"joined by {self.join}"
        std = "" if self.offset_std_s is None else f" ± {self.offset_std_s:.2g} s"
        times = _IMAGE_TIMES.get(self.image_times, "")
        text = f"joined by time{times}, machine's time minus image's time {self.offset_s:.6g} s{std}"
        if self.clock is not None:
            text += _FROM[self.clock.offset_from].format("--offset-s")
            text += (
                f", machine's seconds per image's second {self.clock.rate:.6g} ± {self.clock.rate_std:.2g}"
            )
            text += _FROM[self.clock.rate_from].format("--clock-rate")
        return f"{text}; {self.lost}" if self.lost else text

    def as_dict(self) -> dict[str, object]:
        """Return how the record was joined to the images, as a dict for JSON."""
        clock = self.clock
        return {
            "join": self.join,
            "offset_s": self.offset_s,
            "offset_std_s": self.offset_std_s,
            "offset_from": None if clock is None else clock.offset_from,
            "clock_rate": None if clock is None else clock.rate,
            "clock_rate_std": None if clock is None else clock.rate_std,
            "clock_rate_from": None if clock is None else clock.rate_from,
            "correlation": None if clock is None else clock.correlation,
            "image_times": self.image_times or None,
            "lost_images": self.lost or None,
        }

    def reading(self, k: int) -> dict[str, float]:
        """Return the readings at the image with the index `k`, keyed by their names in tables."""
        known = {"load_n": self.load_n, "displacement_mm": self.displacement_mm, "time_s": self.time_s}
        return {name: float(values[k]) for name, values in known.items() if values is not None}


def join_by_name(record: MachineRecord, images: Sequence[str]) -> JoinedRecord:
    """Give each image the line of the record that names the image, with or without folder and suffix.

    Raises `CurveError` if the record has no names, or an image has no line or several.
    """
    if record.images is None:
        raise record.wrong(
            "join by name", "a column of image names", "none", "name it, such as --image-column Image"
        )
    rows, problem = lines_of(images, record.images)
    if problem:
        remedy = "complete the record, name images with their folders, or join by row or time"
        raise record.wrong("join by name", "one line for each image", problem, remedy)
    return _at_rows(record, rows, "name")


def join_by_row(record: MachineRecord, images: Sequence[str]) -> JoinedRecord:
    """Give the images the lines of the record in order; one extra line at the top belongs to the reference.

    Raises `CurveError` if the number of lines is neither the number of images nor one more.
    """
    more = len(record) - len(images)
    if more not in (0, 1):
        expected = f"{len(images)} lines, one for each image, or one more for the reference before them"
        remedy = "complete the record, or join by name or time"
        raise record.wrong("join by row", expected, str(len(record)), remedy)
    return _at_rows(record, list(range(more, len(record))), "row")


def join_by_time(
    record: MachineRecord,
    images: Sequence[str],
    image_times_s: Float,
    clock: MachineClock,
    strain: Float | None = None,
) -> JoinedRecord:
    """Interpolate the record at the time of each image.

    `images`: names of the images, for messages. `image_times_s`, shape (images,): times of the images on the
    camera's clock. `clock`: the machine's clock; an infinite standard deviation of offset or rate means that
    it is found from the strain. `strain`, shape (images,): the strain in each image, needed to find the
    clock; NaN for an image without strain.

    Raises `CurveError` if the record has no time, a time of the record or the images runs backwards, an image
    was taken before the record begins or after it ends, or the clock cannot be found.
    """
    if record.time_s is None:
        raise record.wrong("join by time", "a column of time", "none", "name it, such as --time Time:s")
    times = np.asarray(image_times_s, np.float64)
    back = np.flatnonzero(~(np.diff(times) >= 0.0))
    if back.size:
        k = int(back[0])
        got = f"{times[k + 1]:g} s of {_file_name(images[k + 1])} after {times[k]:g} s"
        raise record.wrong("image times", "times that do not run backwards", got, "order the images by time")
    if not np.isfinite([clock.offset_std_s, clock.rate_std]).all():
        if strain is None:
            raise ValueError("a clock is found from strain")
        clock = find_clock(record, times, strain, clock)
    clock = clock.sampled(usual_interval_s(record.time_s))
    at = clock.at(times, times[0])
    first, last = record.time_s[0], record.time_s[-1]
    outside = np.flatnonzero((at < first) | (at > last))
    if outside.size:
        k = int(outside[0])
        got = f"{_file_name(images[k])} at {at[k]:.6g} s" + (
            f" and {outside.size - 1} more images outside" if outside.size > 1 else ""
        )
        raise record.wrong(
            "join by time",
            f"images between {first:.6g} s and {last:.6g} s, where the machine recorded",
            got,
            "correct the offset with --offset-s, or leave out the images that the machine did not record",
        )
    displacement = record.displacement_mm
    return JoinedRecord(
        np.interp(at, record.time_s, record.load_n),
        None if displacement is None else np.interp(at, record.time_s, displacement),
        at,
        "time",
        clock.offset_s,
        clock.offset_std_s,
        clock=clock,
        errors_n=clock_errors_n(record, record.time_s, times, clock),
    )


def times_of(images: Sequence[str], times_s: Mapping[str, float], source: str) -> Float:
    """Return the time of each image, found by its name with or without folder and suffix.

    Raises `CurveError` if an image has no time, or its name belongs to several lines.
    """
    values = list(times_s.values())
    rows, problem = lines_of(images, list(times_s))
    if not problem:
        found = np.array([values[row] for row in rows], np.float64)
        gaps = np.flatnonzero(~np.isfinite(found))
        if not gaps.size:
            return found
        problem = f"no time for {images[gaps[0]]}"
    problem = problem.replace("0 lines", "none", 1) if problem.startswith("0 lines") else problem
    remedy = "add its line, or name the images with their folders"
    raise CurveError(source, "image times", "a time for each image", problem, remedy)


def lines_of(images: Sequence[str], names: Sequence[str]) -> tuple[list[int], str]:
    """Return the line that names each image, and a description of what is wrong; "" if nothing is wrong.

    A name with the same suffix as the image is better than a name without suffix. Among equally good names,
    the function chooses the one with the most folders in common with the image, counted from the file name
    upwards.
    """
    places: dict[str, list[int]] = {}
    for k, name in enumerate(names):
        places.setdefault(_stem(name), []).append(k)
    rows: list[int] = []
    owners: dict[int, str] = {}
    for image in images:
        near = places.get(_stem(image), [])
        alike = [_likeness(image, names[k]) for k in near]
        best = [k for k, each in zip(near, alike, strict=True) if each == max(alike)]
        if len(best) != 1:
            return [], f"{len(best)} lines for {_file_name(image)}"
        if owners.setdefault(best[0], image) != image:
            return [], f"one line for both {owners[best[0]]} and {image}"
        rows.append(best[0])
    return rows, ""


def _likeness(image: str, name: str) -> tuple[bool, int]:
    """Return whether two file names have the same suffix, and how many of their folders are equal."""
    ways = [PurePath(each.replace("\\", "/")).parts[::-1] for each in (image, name)]
    agreeing = 0
    for one, other in zip(ways[0][1:], ways[1][1:], strict=False):
        if one != other:
            break
        agreeing += 1
    return ways[0][0] == ways[1][0], agreeing


def _at_rows(record: MachineRecord, rows: list[int], join: str) -> JoinedRecord:
    at = np.array(rows, np.int64)
    displacement, time = (
        None if values is None else values[at] for values in (record.displacement_mm, record.time_s)
    )
    return JoinedRecord(record.load_n[at], displacement, time, join)


def _file_name(name: str) -> str:
    return PurePath(name.replace("\\", "/")).name


def _stem(name: str) -> str:
    return PurePath(_file_name(name)).stem
