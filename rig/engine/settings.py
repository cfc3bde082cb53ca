"""Record the settings that the devices report, before the first image and at the end of a run."""

from collections.abc import Iterator
from typing import Any

from dic.runfile.schema import Moment
from drivers.interfaces import Setting
from rig.device_settings import encode, read_settings, reports_settings
from rig.engine.calls import Call, Deadline
from rig.engine.context import RunContext

READING_S = 5.0
"""Deadline in s for reading the settings of one device. Nothing should move while they are read."""

Settings = dict[str, Setting]


class SettingsRecord:
    """Reads the settings of all devices whose drivers report them, and writes them into the run file."""

    def __init__(self, run: RunContext) -> None:
        self._run = run
        self._first: dict[str, Settings] = {}

    def at_start(self) -> None:
        """Record the settings before the first image.

        Raise `DeviceError` if a device does not report its settings. No device has moved for this run yet.
        """
        begun = {name: self._begin(*found) for name, *found in self._reporting()}
        for name, call in begun.items():
            self._first[name] = self._run.calls.finish(call)
            self._record(name, "start", self._first[name])

    def at_end(self) -> None:
        """Record the settings at the end of the run.

        Record a warning if a setting differs from the start, or a device does not report its settings.
        """
        begun = {}
        for name, called, device in self._reporting():
            if name not in self._first:
                continue
            if self._run.calls.idle(called):
                begun[name] = self._begin(called, device)
            else:
                self._run.log(
                    "warning", f"{name}: its settings are unknown at the end: another call still runs"
                )
        for name, call in begun.items():
            # catch every exception, because a driver of a third party may raise any type
            try:
                found = self._run.calls.finish(call)
            except Exception as error:
                self._run.log("warning", f"{name}: its settings are unknown at the end: {error}")
                continue
            self._record(name, "end", found)
            self._compare(name, self._first[name], found)

    def _reporting(self) -> Iterator[tuple[str, str, Any]]:
        """Yield each device that reports settings: name in the run file, name in calls, and driver."""
        devices = self._run.devices
        known: list[tuple[str, str, Any]] = [
            (name, f"cameras.{name}", each.camera) for name, each in devices.cameras.items()
        ]
        machines = (devices.stage, devices.load_frame)
        known += [(each.name, each.name, each.driver) for each in machines if each is not None]
        known += [(each.name, each.name, each.driver.device) for each in devices.interlocks.values()]
        return (entry for entry in known if reports_settings(entry[2]))

    def _begin(self, called: str, device: Any) -> Call[Settings]:
        return self._run.calls.begin(
            called, "read settings", lambda: read_settings(called, device), Deadline(READING_S)
        )

    def _record(self, name: str, moment: Moment, found: Settings) -> None:
        values = {key: encode(value) for key, value in found.items()}
        self._run.recorder.settings(name, moment, values, self._run.clock.now_s())

    def _compare(self, name: str, first: Settings, last: Settings) -> None:
        for key in sorted(first.keys() | last.keys()):
            before, after = (encode(each[key]) if key in each else "missing" for each in (first, last))
            if before != after:
                self._run.log(
                    "warning", f"{name}: {key} was {before} at the start, and is {after} at the end"
                )
