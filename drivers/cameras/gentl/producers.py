"""Loaded GenTL producers (.cti files) and the cameras that they find, through Harvesters (Apache-2.0)."""

import logging
import os
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from drivers.cameras.gentl.device import Device, reporting, told

PATH_VARIABLE = "GENICAM_GENTL64_PATH"
SEARCH_MS = 1000
"""Longest time in ms for which a producer searches for cameras on one network card or bus."""
SEARCH_AGAIN_MS = 200
"""The same during a run: a longer time would stop the program for too long."""


@dataclass(frozen=True)
class Listed:
    """A camera as its producer lists it. `handle` is the library's object for it."""

    vendor: str
    model: str
    serial: str
    id: str
    name: str
    kind: str
    handle: Any = None

    def is_called(self, name: str) -> bool:
        """Return whether `name` is the camera's serial number, identifier, own name or model."""
        return bool(name) and name in (self.serial, self.id, self.name, self.model)


class Producer:
    """A loaded GenTL producer. A process can load a producer only once, so all cameras share it.

    Get a producer with `loaded`, and call `release` when it is not needed any more.
    """

    def __init__(self, path: str) -> None:
        from harvesters.core import Harvester, ParameterKey, ParameterSet

        logger = logging.getLogger("offaxis.gentl")
        # Harvesters tells of its errors a second time, on the terminal.
        logger.handlers[:] = [logging.NullHandler()]
        logger.propagate = False
        self.path = path
        self.users = 0
        self._connected = 0
        self._lock = threading.Lock()
        self._harvester = Harvester(config=ParameterSet({ParameterKey.LOGGER: logger}))
        self._harvester.add_file(path, check_existence=True, check_validity=True)

    def listed(self) -> list[Listed]:
        """Search for cameras, and return those that the producer finds."""
        with self._lock, reporting():
            return self._search()

    def connect(self, choose: Callable[[Sequence[Listed]], Listed]) -> tuple[Listed, Device]:
        """Search for cameras, and connect the one that the function `choose` returns.

        Call this method on a thread of its own. On the main thread, Harvesters would take over Ctrl-C.
        """
        from harvesters.core import ParameterKey, ParameterSet

        with self._lock, reporting():
            chosen = choose(self._search())
            options = ParameterSet({ParameterKey.ENABLE_AUTO_CHUNK_DATA_UPDATE: False})
            acquirer = self._harvester.create(chosen.handle, config=options)
            self._connected += 1
        return chosen, Device(acquirer, self._disconnected)

    def release(self) -> None:
        """Unload the producer if no other camera uses it."""
        with _LOADING:
            self.users -= 1
            if self.users == 0:
                del _LOADED[self.path]
                with reporting():
                    self._harvester.reset()

    def _disconnected(self) -> None:
        with self._lock:
            self._connected -= 1

    def _search(self) -> list[Listed]:
        known = self._harvester.device_info_list
        if self._connected == 0:
            self._harvester.timeout_for_update = SEARCH_MS
            self._harvester.update()
        else:
            # A whole update would end all connections, so search only where cameras are known.
            self._search_again(known)
        return [_listed(each) for each in known]

    @staticmethod
    def _search_again(known: list[Any]) -> None:
        from harvesters.core import DeviceInfo

        places = list({id(each.parent): each.parent for each in known}.values())
        found = []
        for place in places:
            place.update_device_info_list(SEARCH_AGAIN_MS)
            found += [DeviceInfo(module=each, parent=place) for each in place.device_info_list]
        known[:] = found


_LOADED: dict[str, Producer] = {}
_LOADING = threading.Lock()


def loaded(path: str) -> Producer:
    """Return the producer in a .cti file, and load it first if no camera uses it.

    Raise `OSError` if the file is no producer, and `ImportError` if the packages are not installed.
    """
    path = os.path.realpath(path)
    with _LOADING:
        if path not in _LOADED:
            _LOADED[path] = Producer(path)
        _LOADED[path].users += 1
        return _LOADED[path]


def producers(places: Sequence[str]) -> list[str]:
    """Return the .cti files among files and folders; without any, those of `PATH_VARIABLE`.

    Raise `OSError` if there are none.
    """
    named = list(places) or [each for each in os.environ.get(PATH_VARIABLE, "").split(os.pathsep) if each]
    files = []
    for place in map(Path, named):
        files += sorted(place.glob("*.cti")) if place.is_dir() else [place]
    if not files:
        where = ", ".join(named) or f"the environment variable {PATH_VARIABLE}, which is not set"
        raise FileNotFoundError(f"no .cti file in {where}")
    if missing := [str(file) for file in files if not file.is_file()]:
        raise FileNotFoundError(f"no such file: {', '.join(missing)}")
    return [str(file) for file in files]


def _listed(info: Any) -> Listed:
    return Listed(
        vendor=told(lambda: str(info.vendor), ""),
        model=told(lambda: str(info.model), ""),
        serial=told(lambda: str(info.serial_number), ""),
        id=told(lambda: str(info.id_), ""),
        name=told(lambda: str(info.user_defined_name), ""),
        kind=told(lambda: str(info.tl_type), ""),
        handle=info,
    )
