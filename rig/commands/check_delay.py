"""Measure the delay of a channel against the cameras of a rig, with a light or a line that both know."""

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np

from drivers.errors import DeviceError
from drivers.settings import toml_table
from rig.channels.delay import Delay, find_delay
from rig.channels.edges import LEAST_CONTRAST, Edges, edges_of_light, edges_of_signal, levels_of
from rig.channels.line_delay import edges_of_line, find_line_delay
from rig.channels.run_channels import RunChannels
from rig.commands.films import Film, LightFilm
from rig.devices import Rig
from rig.engine.calls import Call, Calls, Deadline
from rig.errors import RigError
from rig.rigfile import RigFile
from rig.samples import TimedSamples

SECONDS = 30.0
_SPARE_S = 30.0
_BEFORE_S, _AFTER_S = 2.0, 0.5
"""Time in s before the film, in which the channel's times settle, and after it, for late samples."""
_POLL_S = 0.05
_ALIKE_TIMES = 3.0


@dataclass
class DelayCheck:
    """The result of the measurement: lines to print, a table for JSON, problems, and cameras that failed."""

    lines: list[str] = field(default_factory=list)
    delays: dict[str, Any] = field(default_factory=dict)
    problems: list[str] = field(default_factory=list)
    failed: dict[str, str] = field(default_factory=dict)


def only_delay(rig_file: RigFile, wanted: str) -> tuple[RigFile, str]:
    """Return the rig with the cameras and the device of one channel only, and the name of its signal."""
    signal = wanted.removeprefix("channels.")
    owners = {
        known.name: name
        for name, entry in rig_file.channels.items()
        for known in entry.setting("declared") or ()
    }
    if signal not in owners:
        known = ", ".join(f"channels.{name}" for name in owners) or "none"
        raise RigError(
            str(rig_file.path),
            f"--delay with a signal of the rig ({known})",
            repr(wanted),
            "correct the name",
        )
    channels = {owners[signal]: rig_file.channels[owners[signal]]}
    nothing: dict[str, Any] = {"interlocks": {}, "triggers": {}, "measured_load": None}
    return replace(rig_file, stage=None, load_frame=None, channels=channels, **nothing), signal


def measure_delay(
    rig: Rig, signal: str, seconds: float, say: Callable[[str], None] = lambda _: None
) -> DelayCheck:
    """Film with all cameras while somebody switches a light, whose voltage is the signal.

    Raise `DeviceError` if the channel device fails, and `RigError` if the channel does not switch.
    """
    films = {name: LightFilm(camera, camera.info.bits) for name, camera in rig.cameras.items()}
    begun = f"switch the light on and off at irregular times, for {seconds:g} s from now"
    recorded = _Recorded(rig, films, signal, seconds, lambda: say(begun))
    levels = levels_of(recorded.values)
    if levels.contrast < LEAST_CONTRAST:
        raise recorded.without_edges(
            "wire the voltage of the light to this input, and switch the light on and off"
        )
    edges = edges_of_signal(recorded.times_s, recorded.values, levels)
    return recorded.told(lambda film: _delay_of_light(film, edges, recorded.span_s), "middle")


def measure_line_delay(
    rig: Rig, signal: str, seconds: float, *, rising: bool, say: Callable[[str], None] = lambda _: None
) -> DelayCheck:
    """Film with all cameras, while the signal is a line whose edges are the beginnings of exposures.

    `rising` is the direction of these edges. Raise the same errors as `measure_delay`.
    """
    films = {name: Film(camera, camera.info.bits) for name, camera in rig.cameras.items()}
    recorded = _Recorded(rig, films, signal, seconds, lambda: say(f"filming for {seconds:g} s from now"))
    line = edges_of_line(recorded.times_s, recorded.values, rising=rising)
    if line is None:
        raise recorded.without_edges("wire the line of the camera to this input")

    def delay_of(film: Film) -> Delay | str:
        middles_s, lengths_s = film.times
        if not (lengths_s > 0.0).all():
            return "the exposure time is not known, so nobody knows when an exposure begins"
        return find_line_delay(np.unique(middles_s - lengths_s / 2), line, recorded.span_s)

    return recorded.told(delay_of, "beginning")


class _Recorded:
    """The frames of all cameras, and the samples of a signal that were taken at the same time."""

    def __init__(
        self, rig: Rig, films: Mapping[str, Film], signal: str, seconds: float, begun: Callable[[], None]
    ) -> None:
        self._check, self._films, self._name = DelayCheck(), films, signal
        ((self._device_name, device),) = rig.channels.items()
        column = [each.name for each in device.signals].index(signal)
        self._unit = device.signals[column].unit
        samples = _record(rig, films, seconds, self._check, begun)
        self.times_s = np.concatenate([each.time_s for each in samples])
        self.values = np.concatenate([each.values[:, column] for each in samples])

    @property
    def span_s(self) -> tuple[float, float]:
        """The times of the first and the last sample."""
        return float(self.times_s[0]), float(self.times_s[-1])

    def without_edges(self, remedy: str) -> RigError:
        """Return the error that the signal does not switch."""
        values = self.values
        return RigError(
            f"channels.{self._name}",
            "a signal that switches between two levels",
            f"one from {values.min():.6g} to {values.max():.6g} {self._unit} without edges",
            remedy,
        )

    def told(self, delay_of: Callable[[Any], Delay | str], moment: str) -> DelayCheck:
        """Return the delays of all cameras. `moment` says of which moment of the exposure."""
        for camera, film in self._films.items():
            if f"cameras.{camera}" not in self._check.failed:
                delay = delay_of(film) if film.middles_s else "no image was taken"
                _tell(self._check, camera, self._name, delay, moment)
        _tell_rig_file(self._check, self._device_name, self._name)
        return self._check


def _record(
    rig: Rig, films: Mapping[str, Film], seconds: float, found: DelayCheck, begun: Callable[[], None]
) -> list[TimedSamples]:
    """Film with all cameras at the same time, and return the samples of the channel device.

    `begun` is called when the film begins.
    """
    samples: list[TimedSamples] = []
    channels = RunChannels(rig.channels, rig.clock, lambda _, timed: samples.append(timed))
    calls = Calls(rig.clock, lambda: None, rig.lost, meanwhile=channels.read, every_s=_POLL_S)
    with rig.clock.activity():
        try:
            channels.begin()
            while not channels.are_ready:
                calls.pause(_POLL_S)
            calls.pause(_BEFORE_S)
            begun()
            until_s = rig.clock.now_s() + seconds
            running = {name: _begin(calls, rig, name, film, until_s) for name, film in films.items()}
            for name, call in running.items():
                try:
                    calls.finish(call, watched=True)
                except DeviceError as error:
                    channels.read()  # an error of the channel ends the measurement
                    found.failed[f"cameras.{name}"] = str(error)
            calls.pause(_AFTER_S)
            channels.read()
        finally:
            rig.lost.update(channels.end())
            calls.close()
    return list(samples)


def _begin(calls: Calls, rig: Rig, name: str, film: Film, until_s: float) -> Call[None]:
    deadline = Deadline(until_s - rig.clock.now_s() + _SPARE_S, "check the camera and its cable")
    return calls.begin(f"cameras.{name}", "film", lambda: film.take(rig.clock.now_s, until_s), deadline)


def _delay_of_light(film: LightFilm, signal: Edges, span_s: tuple[float, float]) -> Delay | str:
    values = film.brightness()
    levels = levels_of(values)
    if levels.contrast < LEAST_CONTRAST:
        return (
            f"0 edges in {len(values)} images: their brightness does not switch between two levels; bring "
            "the light into view and switch it"
        )
    bright = levels.share(values) > 0.5
    full = np.array(film.full)
    saturated = bool(full[bright].mean() >= full[~bright].mean() + 1.0)
    light = edges_of_light(*film.times, values, levels, saturated=saturated)
    return find_delay(light, signal, span_s)


def _tell(found: DelayCheck, camera: str, signal: str, delay: Delay | str, moment: str) -> None:
    where = f"cameras.{camera}"
    if isinstance(delay, str):
        found.failed[where] = f"{where}: {delay}"
        return
    found.delays[camera] = asdict(delay)
    found.lines += [
        f"{where}: channels.{signal} is {delay.delay_s:.4f} s later than the {moment} of the exposure",
        f"  from {delay.edges} edges, {delay.missing} others were not found; the mean is known to "
        f"{1e3 * delay.mean_std_s:.2g} ms, the delay varies by {1e3 * delay.jitter_s:.2g} ms",
    ]
    if delay.others_s:
        others = ", ".join(f"{other_s:.2f}" for other_s in delay.others_s[:3])
        found.problems.append(
            f"{where}: the edges are so regular that delays of {others} s fit as well; "
            + (
                "switch the light at irregular times"
                if moment == "middle"
                else "let the camera film more slowly, or trigger it at irregular times"
            )
        )
    if delay.delay_s < -_ALIKE_TIMES * delay.delay_std_s:
        found.problems.append(
            f"{where}: the images are later than the channel, so the times of the camera's driver are late; "
            "no delay_s can state this"
        )


def _tell_rig_file(found: DelayCheck, device: str, signal: str) -> None:
    """Tell what to write into the rig file, from the camera that knows the delay best."""
    if not found.delays:
        return
    best = min(found.delays.values(), key=lambda delay: delay["mean_std_s"])
    for camera, delay in found.delays.items():
        apart_s = abs(delay["delay_s"] - best["delay_s"])
        known_s = float(np.hypot(delay["mean_std_s"], best["mean_std_s"]))
        if apart_s > _ALIKE_TIMES * known_s:
            found.problems.append(
                f"cameras.{camera}: its delay differs by {1e3 * apart_s:.2g} ms from that of another camera: "
                "the times of one of them are not those of its exposures"
            )
    settings = {
        "delay_s": round(max(0.0, best["delay_s"]), 4),
        "delay_std_s": round(best["delay_std_s"], 5),
    }
    table = toml_table(["channels", device, "signals", signal], settings)
    found.lines += ["write into the rig file, for this and all signals on the same way:", *table.splitlines()]
