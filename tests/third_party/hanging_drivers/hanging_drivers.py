"""Drivers of a third party that work until a call of them never returns.

Each driver is a driver of offaxis with three more keys: the method that hangs, the number of the call at
which it hangs (for reading, counted while the device moves), and the file to which the time of the hang is
written.
"""

import threading
import time
from pathlib import Path
from typing import Any

from drivers import DriverSpec, OpenContext, find_driver


class _Hanging:
    """A device whose method `hang_in` never returns once it was called `hang_at` times."""

    def __init__(self, device: Any, settings: Any) -> None:
        self._device = device
        self._settings = settings
        self._left = settings.hang_at

    def __getattr__(self, name: str) -> Any:
        made = getattr(self._device, name)
        return made if name != self._settings.hang_in else lambda *given: self._hang(made, *given)

    def _hang(self, made: Any, *given: Any) -> Any:
        result = made(*given)
        self._left -= getattr(result, "moving", True)
        if self._left > 0:
            return result
        Path(self._settings.hung).write_text(f"{time.monotonic()!r}")
        return threading.Event().wait()


def _like(driver: str) -> DriverSpec:
    spec = find_driver(driver)

    class Settings(spec.settings):  # type: ignore[misc, name-defined]
        hang_in: str
        hang_at: int
        hung: str

    def open_device(settings: Any, context: OpenContext) -> _Hanging:
        ours = settings.model_dump(exclude={"hang_in", "hang_at", "hung"}, exclude_unset=True)
        return _Hanging(spec.open(spec.settings.model_validate(ours), context), settings)

    return DriverSpec(spec.kind, Settings, open_device)


STAGE = _like("zaber-ascii")
LOAD_FRAME = _like("modbus-frame")
CAMERA = _like("remote-camera")
