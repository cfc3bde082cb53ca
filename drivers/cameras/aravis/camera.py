"""Driver for GigE Vision and USB3 Vision cameras, with the Aravis library (Debian's libaravis-0.8-0)."""

import contextlib
import threading
from collections.abc import Callable
from concurrent.futures import Future, wait
from typing import Any, TypeVar

from drivers.cameras.aravis.find import FINDER
from drivers.cameras.aravis.library import Aravis, AravisError, load
from drivers.cameras.aravis.session import AravisSession
from drivers.cameras.aravis.settings import AravisSettings
from drivers.cameras.filming import FilmingCamera, refuse_simulated_time
from drivers.errors import DeviceError, DeviceTimeout, LinkLost
from drivers.interfaces import CameraInfo, OpenContext
from drivers.registry import DriverSpec

T = TypeVar("T")
GIVING_UP_S = 20.0
"""Longest time, in seconds, that `close` waits for a connection to end.

Aravis needs up to 13 s to close the connection to a camera that is disconnected.
"""


class AravisCamera(FilmingCamera[AravisSession]):
    """A `Camera` through Aravis. To construct this class, call `open_camera`.

    If `grab` waits for three frame times without a frame, the camera counts as lost. The driver then closes
    the connection, and the next call opens and configures the camera again. A separate thread closes and
    opens the camera, so that calls keep their deadlines.
    """

    silent_is_lost = True

    def __init__(self, settings: AravisSettings, context: OpenContext, library: Aravis) -> None:
        super().__init__(f"{context.name} ({settings.camera})", context.clock)
        self._settings = settings
        self._library = library
        self._aside: Future[AravisSession | None] | None = None
        self._serial: str | None = None
        self._session = session = self._open()
        self._serial = session.serial
        self.info = CameraInfo(
            vendor=session.vendor,
            model=session.model,
            serial=session.serial,
            width_px=settings.width_px,
            height_px=settings.height_px,
            bits=settings.bits,
        )

    def close(self) -> None:
        """Release the camera. A repeated call has no effect.

        If the camera does not answer, the method waits for a limited time only.
        """
        super().close()
        with self._lock:
            aside, self._aside = self._aside, None
        if aside is not None and _is_done(aside, GIVING_UP_S):
            with contextlib.suppress(DeviceError):  # a camera that could not be reopened needs no closing
                if (session := aside.result()) is not None:
                    session.close()

    def _open_again(self, step: str, deadline_s: float) -> AravisSession:
        session: AravisSession | None = None
        while session is None:
            if self._aside is None:
                self._aside = _aside(f"open {self._name}", self._open)
            if not _is_done(self._aside, deadline_s - self._clock.now_s()):
                raise DeviceTimeout(
                    self._name,
                    step,
                    "a camera that can be opened again in time",
                    "a connection that is still being given up or made",
                    "check cable, power and the firewall, or allow more time",
                )
            aside, self._aside = self._aside, None
            session = aside.result()
        return session

    def _open(self) -> AravisSession:
        try:
            session = AravisSession(self._library, self._settings, self._name, self._clock)
        except AravisError as error:
            raise self._lost(str(error)) from error
        if self._serial is not None and session.serial != self._serial:
            session.close()
            raise self._lost(f"the camera with serial number {session.serial}")
        return session

    def _lost(self, got: str) -> LinkLost:
        known = "a free camera" if self._serial is None else f"the camera with serial number {self._serial}"
        return LinkLost(
            self._name,
            "open camera",
            known,
            got,
            "check cable, power and address, and that no other program controls the camera",
        )

    def _give_up(self) -> None:
        session, self._session = self._session, None
        if session is not None:
            self._aside = _aside(f"close {self._name}", session.close)


def _aside(name: str, act: Callable[[], T]) -> "Future[T]":
    """Open or close a camera on a separate thread, because Aravis takes seconds if a camera is silent."""
    done: Future[T] = Future()

    def run() -> None:
        try:
            done.set_result(act())
        except Exception as error:  # `result` raises the exception again
            done.set_exception(error)

    threading.Thread(target=run, name=name, daemon=True).start()
    return done


def _is_done(aside: "Future[Any]", timeout_s: float) -> bool:
    return bool(wait([aside], max(0.0, timeout_s)).done)


def open_camera(settings: AravisSettings, context: OpenContext) -> AravisCamera:
    """Open a camera, write its settings, read the settings back and start filming.

    Raise `DeviceError` if the library is missing, the camera cannot be opened, or a setting reads back
    differently.
    """
    name = f"{context.name} ({settings.camera})"
    refuse_simulated_time(name, context)
    try:
        library = load()
    except OSError as error:
        raise DeviceError(
            name,
            "load Aravis",
            "the library of Debian's package libaravis-0.8-0",
            str(error),
            "apt install libaravis-0.8-0",
        ) from error
    return AravisCamera(settings, context, library)


SPEC = DriverSpec(kind="camera", settings=AravisSettings, open=open_camera, find=FINDER)
