"""The readings of all devices at the middle of each camera's exposures, with their standard deviations.

A reading comes from the dense record of a channel device, whose times are corrected for the delay of the
signal, or from the table of a load frame or a stage. Two kinds of errors of time matter where the reading
changes. Those that all images share are the delay, the offset between the clocks, and the time from exposure
to time stamp: `RunStep.load_lag_n` is their effect on the load. The times of samples that were taken on
request differ each in their own way.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from dic.runfile.at_time import Estimates, SignalRecord, estimate
from dic.runfile.channels import RunSignal
from dic.runfile.joined import JoinedRun
from dic.runfile.reader import RunFile
from dic.runfile.schema import MIDDLE, is_about_a_gauge, value_of
from dic.runfile.steps import ChannelValue, RunStep
from dic.typing import Float, Indices

READING_STD_S = 0.01
"""Standard deviation of the time between the measurement in a load frame or a stage and its answer."""
_OF_DEVICES = {
    "load_n": ("instrument/load_frame", "load", "load_std_n"),
    "displacement_mm": ("instrument/load_frame", "displacement", "displacement_std_mm"),
    "angle_deg": ("instrument/stage", "", "angle_std_deg"),
}
"""For each reading: its table, the quantity of a signal that replaces it, and its standard deviation."""
_READINGS = {quantity: reading for reading, (_, quantity, _) in _OF_DEVICES.items() if quantity}


@dataclass(frozen=True)
class ExposedSteps:
    """The steps of a run as a camera saw them.

    Attributes
    ----------
    steps : list of RunStep
        The steps except the grid, as `RunFile.series` returns them, with the readings at the middle of the
        exposures.
    remarks : list of str
        One sentence for each reading that is not known at all exposures.
    """

    steps: list[RunStep]
    remarks: list[str]


def steps_at_exposure(run: RunFile, *, readings: bool = True) -> dict[str, ExposedSteps]:
    """Return the steps of a run with the readings at the middle of each camera's exposures, by the camera.

    Without `readings`, only the times are those of the exposures, and no record of a device is read.

    If the record of a device does not cover the exposures of a step, its reading after settling is kept, with
    a standard deviation that follows from the changes of the record beside it. The value of another signal is
    then NaN.
    """
    earlier = steps_at_exposure(run.earlier, readings=readings) if isinstance(run, JoinedRun) else {}
    own = run.own_steps if isinstance(run, JoinedRun) else run.steps
    steps = [step for step in own if step.kind != "grid"]
    exposures = {camera: _exposures(run, camera, steps) for camera in run.cameras}
    found = {camera: _Steps(list(steps), each) for camera, each in exposures.items()}
    at = np.concatenate([each.middle_s for each in exposures.values()])
    lengths = np.concatenate([each.length_s for each in exposures.values()])
    ends = np.cumsum([len(each.middle_s) for each in exposures.values()])[:-1]
    for source in _sources(run) if readings else ():
        known = estimate(source.record, at, lengths)
        parts = zip(*(np.split(values, ends) for values in vars(known).values()), strict=True)
        for of_camera, values in zip(found.values(), parts, strict=True):
            of_camera.add(source, Estimates(*values))
    return {camera: each.joined(earlier.get(camera)) for camera, each in found.items()}


@dataclass(frozen=True)
class _Exposures:
    """The exposures of a camera at the steps of a run; arrays have one value for each image.

    `count`, shape (steps,), is the number of images of each step.
    """

    middle_s: Float
    middle_std_s: Float
    length_s: Float
    count: Indices

    def means(self, values: Float) -> Float:
        """Return the mean over the images of each step; NaN without an image."""
        sums = np.concatenate([[0.0], np.cumsum(np.nan_to_num(values))])
        lost = np.concatenate([[0], np.cumsum(np.isnan(values))])
        stop = np.cumsum(self.count)
        first = stop - self.count
        with np.errstate(divide="ignore", invalid="ignore"):
            means = (sums[stop] - sums[first]) / self.count
        return np.where((self.count > 0) & (lost[stop] == lost[first]), means, np.nan)

    @property
    def spans_s(self) -> Float:
        """The time from the first to the last image of each step."""
        ends = np.cumsum(self.count)
        at = np.append(self.middle_s, np.nan)
        return np.where(self.count > 0, at[ends - 1] - at[ends - self.count], np.nan)


def _exposures(run: RunFile, camera: str, steps: list[RunStep]) -> _Exposures:
    columns = run.columns(f"instrument/{camera}", *_OF_FRAMES)
    count = np.array([len(run.rows(camera, step)) for step in steps], np.int64)
    rows = np.array([row for step in steps for row in run.rows(camera, step)], np.int64)
    on_file = rows < min(map(len, columns.values()))
    taken = {
        name: np.where(on_file, values[np.where(on_file, rows, 0)], np.nan)
        for name, values in columns.items()
    }
    length_s = 1e-6 * taken["exposure_us"]
    middle_s, std_s = middles(taken["exposed_s"], taken["received_s"], length_s)
    stated, stated_std = (item.name for item in MIDDLE)
    if stated in taken:
        known = np.isfinite(taken[stated])
        middle_s = np.where(known, taken[stated], middle_s)
        std_s = np.where(known, taken[stated_std], std_s)
    return _Exposures(middle_s, std_s, length_s, count)


_OF_FRAMES = ("exposed_s", "received_s", "exposure_us", *(item.name for item in MIDDLE))


def middles(exposed_s: Float, received_s: Float, length_s: Float) -> tuple[Float, Float]:
    """Return the middles of exposures and their standard deviations, if no driver has estimated them.

    An exposure began somewhere between `exposed_s` and the last moment at which it could still end before
    `received_s`. If its length is unknown, it may have been anything up to that time.
    """
    length_s = np.nan_to_num(length_s)
    spread_s = np.maximum(received_s - exposed_s - length_s, 0.0)
    return exposed_s + 0.5 * (length_s + spread_s), spread_s / np.sqrt(12.0)


@dataclass(frozen=True)
class _Source:
    """The record of a reading.

    `reading` is the name of the reading in `RunStep`, or "" for another signal. `shared_std_s` is the
    standard deviation of the time that all values share.
    """

    name: str
    record: SignalRecord
    shared_std_s: float
    reading: str = ""
    signal: RunSignal | None = None

    @property
    def what(self) -> str:
        return self.reading.rpartition("_")[0] or f"channels.{self.name}"


def _sources(run: RunFile) -> Iterator[_Source]:
    """Yield the record of each reading that the run has, one at a time."""
    taken = set()
    for device, signals in run.channels.items():
        for name, signal in signals.items():
            if is_about_a_gauge(name):
                continue
            reading = next(
                (key for key, (_, of, _) in _OF_DEVICES.items() if of and of == signal.quantity), ""
            )
            taken.add(reading)
            yield _of_channel(run, device, name, signal, reading)
    for reading, (table, *_) in _OF_DEVICES.items():
        columns = run.columns(table, "time_s", reading)
        if columns and reading not in taken:
            record = SignalRecord.of(columns["time_s"], columns[reading])
            yield _Source(reading, record, READING_STD_S, reading)


def _of_channel(run: RunFile, device: str, name: str, signal: RunSignal, reading: str) -> _Source:
    columns = run.columns(f"channels/{device}", "time_s", "time_std_s", "device_s", value_of(name))
    time_s, values, std_s = columns["time_s"], columns[value_of(name)], columns["time_std_s"]
    own_clock = np.isfinite(columns["device_s"])
    # The clock of a device is compared with the rig's clock once for all, each answer to a request anew.
    shared_s = float(np.median(std_s[own_clock])) if own_clock.any() else 0.0
    inside = (values >= signal.low) & (values <= signal.high)
    record = SignalRecord.of(
        time_s - signal.delay_s,
        np.where(inside, values, np.nan),
        np.where(own_clock, 0.0, std_s),
        signal.std,
    )
    return _Source(name, record, float(np.hypot(signal.delay_std_s, shared_s)), reading, signal)


class _Steps:
    """The steps of one camera, to which readings are added."""

    def __init__(self, steps: list[RunStep], exposures: _Exposures) -> None:
        self._exposures, self._remarks = exposures, list[str]()
        time_s, std_s = (exposures.means(each) for each in (exposures.middle_s, exposures.middle_std_s))
        self._steps = [
            step if np.isnan(at_s) else _timed(step, at_s, own_s)
            for step, at_s, own_s in zip(steps, time_s.tolist(), std_s.tolist(), strict=True)
        ]
        self._time_s = np.array([step.time_s for step in self._steps])
        self._time_std_s = std_s

    def add(self, source: _Source, found: Estimates) -> None:
        """Add a reading. `found` has the values at all exposures."""
        exposures = self._exposures
        value, slope = exposures.means(found.value), exposures.means(found.slope)
        with np.errstate(divide="ignore", invalid="ignore"):
            # images that are close to each other have the same noise
            independent = 1.0 + exposures.spans_s / exposures.means(found.apart_s)
        independent = np.clip(independent, 1.0, np.maximum(exposures.count, 1))
        own = exposures.means(found.noise**2) / independent + exposures.means(found.course**2)
        lag = slope * np.hypot(source.shared_std_s, self._time_std_s)
        std = np.sqrt(own + lag**2)
        lost = np.isnan(value)
        if source.signal is None or source.reading:
            settled = np.array([getattr(step, source.reading) for step in self._steps])
            lost &= np.isfinite(settled)
            use = lost & ~source.record.is_invalid_near(self._time_s)
            value, lag = np.where(use, settled, value), np.where(use, 0.0, lag)
            std = np.where(use, source.record.std_beyond(self._time_s), std)
            self._put(source.reading, value, std, lag)
        else:
            self._put_channel(source.name, source.signal, value, std, lag)
        if lost.any():
            self._remarks.append(_remark(source, int(np.count_nonzero(lost)), len(lost)))

    def _put(self, reading: str, value: Float, std: Float, lag: Float) -> None:
        names = [reading, _OF_DEVICES[reading][2], *(["load_lag_n"] if reading == "load_n" else [])]
        columns = (each.tolist() for each in (value, std, lag)[: len(names)])
        changes = (dict(zip(names, row, strict=True)) for row in zip(*columns, strict=True))
        self._steps = [replace(step, **each) for step, each in zip(self._steps, changes, strict=True)]

    def _put_channel(self, name: str, signal: RunSignal, value: Float, std: Float, lag: Float) -> None:
        known = zip(self._steps, value.tolist(), std.tolist(), lag.tolist(), strict=True)
        self._steps = [
            replace(step, channels=(*step.channels, ChannelValue(name, signal.unit, *values)))
            for step, *values in known
        ]

    def joined(self, earlier: ExposedSteps | None) -> ExposedSteps:
        """Return the steps after those of an earlier run; all of them have the channels of both."""
        if earlier is None:
            return ExposedSteps(self._steps, self._remarks)
        steps = earlier.steps + self._steps
        every = {each.name: each.unit for step in steps for each in step.channels}
        unknown = {name: ChannelValue(name, unit, np.nan) for name, unit in every.items()}

        def filled(step: RunStep) -> RunStep:
            own = {each.name: each for each in step.channels if each.unit == every[each.name]}
            return replace(step, channels=tuple((unknown | own).values()))

        return ExposedSteps(list(map(filled, steps)), earlier.remarks + self._remarks)


def _timed(step: RunStep, at_s: float, std_s: float) -> RunStep:
    return replace(step, time_s=at_s, time_std_s=std_s, late_s=at_s - step.due_s)


def _remark(source: _Source, lost: int, count: int) -> str:
    kept = "the reading after settling is used" if source.reading else "there is no value"
    return f"{source.what}: its record does not cover the exposures of {lost} of {count} steps, so {kept}"
