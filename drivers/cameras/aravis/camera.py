"""Driver for GigE Vision and USB3 Vision cameras, with the Aravis library (Debian's libaravis-0.8-0)."""

import contextlib
import threading
from collections.abc import Callable

from drivers.cameras.aravis.find import FINDER
from drivers.cameras.aravis.library import Aravis, AravisError, load
from drivers.cameras.aravis.session import AravisSession
from drivers.cameras.aravis.settings import AravisSettings
from drivers.cameras.filming import FilmingCamera, refuse_simulated_time
from drivers.errors import DeviceError, DeviceTimeout, LinkLost
from drivers.interfaces import CameraInfo, OpenContext
from drivers.registry import DriverSpec

GIVING_UP_S = 20.0
"""Longest time, in seconds, that `close` waits for a connection to end.

Aravis needs up to 13 s to close the connection to a camera that is disconnected.
"""


class _Aside:
    """Opens or closes a camera on a separate thread, because Aravis takes seconds if a camera is silent."""

    def __init__(self, name: str, act: Callable[[], AravisSession | None]) -> None:
        self._act = act
        self._session: AravisSession | None = None
        self._error: Exception | None = None
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def is_done(self, timeout_s: float) -> bool:
        """Wait up to `timeout_s` seconds for the end of opening or closing. Return whether it has ended."""
        self._thread.join(max(0.0, timeout_s))
        return not self._thread.is_alive()

    def result(self) -> AravisSession | None:
        """Return the opened session, or None after closing. Raise the exception if the action failed."""
        if self._error is not None:
            raise self._error
        return self._session

    def _run(self) -> None:
        try:
            self._session = self._act()
        except Exception as error:  # keep the exception, which the method `result` raises again
            self._error = error


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
        self._aside: _Aside | None = None
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
        if aside is not None and aside.is_done(GIVING_UP_S):
            with contextlib.suppress(DeviceError):  # a camera that could not be reopened needs no closing
                if (session := aside.result()) is not None:
                    session.close()

    def _open_again(self, step: str, deadline_s: float) -> AravisSession:
        session: AravisSession | None = None
        while session is None:
            if self._aside is None:
                self._aside = _Aside(f"open {self._name}", self._open)
            if not self._aside.is_done(deadline_s - self._clock.now_s()):
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
            self._aside = _Aside(f"close {self._name}", session.close)


def open_camera(settings: AravisSettings, context: OpenContext) -> AravisCamera:
    """Open a camera, write its settings, read the settings back and start filming.

    Raises
    ------
    DeviceError
        If the library is missing, the camera cannot be opened, or a setting reads back differently.
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
