"""GigE Vision and USB3 Vision cameras, through Debian's Aravis library (package libaravis-0.8-0)."""

import threading

from drivers.aravis_library import Aravis, AravisError, load
from drivers.aravis_session import Session
from drivers.aravis_settings import AravisSettings
from drivers.clock import VirtualClock
from drivers.errors import DeviceError, DeviceFault, DeviceTimeout, LinkLost
from drivers.frame_stream import CAPACITY, FrameStream
from drivers.interfaces import CameraInfo, Frame, OpenContext
from drivers.registry import DriverSpec

SILENCE_S = 1.0
SILENCE_FRAMES = 10
OPENING_S = 20.0
"""How long a stream waits for a connection to be given up before the camera is opened anew."""


class AravisCamera:
    """A `Camera`; construct it with `open_camera`.

    It films all the time; `grab` throws away what was exposed before the call. After a call that got no frame
    the camera is not trusted: the next one opens it anew and sets it up again.
    """

    info: CameraInfo

    def __init__(self, settings: AravisSettings, context: OpenContext, library: Aravis) -> None:
        self._settings = settings
        self._clock = context.clock
        self._library = library
        self._name = f"{context.name} ({settings.camera})"
        self._lock = threading.Lock()
        self._stream: FrameStream | None = None
        self._closed = False
        self._retiring: threading.Thread | None = None
        self._serial: str | None = None
        self._session: Session | None = self._open()
        session = self._session
        self._serial = session.serial
        self.info = CameraInfo(
            vendor=session.vendor,
            model=session.model,
            serial=session.serial,
            width_px=settings.width_px,
            height_px=settings.height_px,
            bits=settings.bits,
        )

    def grab(self, timeout_s: float) -> Frame:
        """Return a frame whose exposure began after this call; its flags are Aravis' buffer status.

        Raises
        ------
        DeviceTimeout
            If there is none after `timeout_s`.
        LinkLost
            If the camera does not answer any more.
        DeviceFault
            If a setting has changed, or a stream is open.
        """
        asked_s = self._clock.now_s()
        with self._lock:
            session = self._ready("grab", asked_s + timeout_s)
            session.drain()
            frame = session.next_frame(asked_s + timeout_s - self._clock.now_s(), after_s=asked_s)
            if frame is not None:
                try:
                    session.verify()
                except AravisError as error:
                    self._retire()
                    raise self._lost("grab", str(error)) from error
                return frame
            self._retire()
        raise self._late("grab", f"none within {timeout_s:g} s")

    def stream(self, capacity: int = CAPACITY) -> FrameStream:
        """Return a stream of all frames from now on; `grab` is refused until it is closed."""
        with self._lock:
            begun_s = self._clock.now_s()
            session = self._ready("stream", begun_s + OPENING_S)
            session.drain()

            def source(timeout_s: float) -> Frame | None:
                return session.next_frame(timeout_s, after_s=begun_s)

            interval_s = 1 / self._settings.rate_hz
            self._stream = FrameStream(
                self._name,
                source,
                self._clock,
                interval_s=interval_s,
                silence_s=max(SILENCE_S, SILENCE_FRAMES * interval_s),
                capacity=capacity,
                on_close=self._stream_closed,
            )
            return self._stream

    def close(self) -> None:
        """Release the camera; harmless when repeated."""
        if self._stream is not None:
            self._stream.close()
        with self._lock:
            self._closed = True
            self._retire()
            if self._retiring is not None:
                self._retiring.join()
                self._retiring = None

    def _stream_closed(self) -> None:
        self._stream = None

    def _ready(self, step: str, deadline_s: float) -> Session:
        if self._closed or self._stream is not None:
            raise DeviceFault(
                self._name,
                step,
                expected="an open camera without an open stream",
                got="a closed camera" if self._closed else "a stream that takes every frame",
                remedy="open the camera again"
                if self._closed
                else "take the frame from the stream, or close it",
            )
        if self._retiring is not None:
            self._retiring.join(max(0.0, deadline_s - self._clock.now_s()))
            if self._retiring.is_alive():
                raise self._late(step, "a connection that is still being given up")
            self._retiring = None
        if self._session is None:
            self._session = self._open()
        return self._session

    def _open(self) -> Session:
        try:
            session = Session(self._library, self._settings, self._name, self._clock)
        except AravisError as error:
            raise self._lost("open camera", str(error)) from error
        if self._serial is not None and session.serial != self._serial:
            session.close()
            raise self._lost("open camera", f"the camera with serial number {session.serial}")
        return session

    def _lost(self, step: str, got: str) -> LinkLost:
        return LinkLost(
            self._name,
            step,
            expected="a free camera"
            if self._serial is None
            else f"the camera with serial number {self._serial}",
            got=got,
            remedy="check cable, power and address, and that no other program controls the camera",
        )

    def _retire(self) -> None:
        """Close the session aside: a camera that does not answer is asked for ten seconds."""
        session, self._session = self._session, None
        if session is not None:
            self._retiring = threading.Thread(target=session.close, name=f"close {self._name}", daemon=True)
            self._retiring.start()

    def _late(self, step: str, got: str) -> DeviceTimeout:
        return DeviceTimeout(
            self._name,
            step,
            expected="a frame exposed after the call, in time",
            got=got,
            remedy="check cable, power and the firewall, or allow more time",
        )


def open_camera(settings: AravisSettings, context: OpenContext) -> AravisCamera:
    """Open a camera, write its settings, read them back and let it film.

    Raises
    ------
    DeviceError
        If the library is missing, the camera cannot be opened, or takes a setting differently.
    """
    name = f"{context.name} ({settings.camera})"
    if isinstance(context.clock, VirtualClock):
        raise DeviceFault(
            name,
            "open camera",
            expected="a rig in real time",
            got="simulated time, of which a real camera knows nothing",
            remedy="use driver 'simulated-camera' in a simulated rig",
        )
    try:
        library = load()
    except OSError as error:
        raise DeviceError(
            name,
            "load Aravis",
            expected="the library of Debian's package libaravis-0.8-0",
            got=str(error),
            remedy="apt install libaravis-0.8-0",
        ) from error
    return AravisCamera(settings, context, library)


SPEC = DriverSpec(kind="camera", settings=AravisSettings, open=open_camera)
