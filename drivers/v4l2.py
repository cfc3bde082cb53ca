"""Cameras on Linux' own camera interface (V4L2): full depth, settings read back, frames proven fresh.

Only the kernel is needed, no library. What the interface does not promise, and what is done about it, stands
in docs/cameras.md.
"""

import contextlib
import threading
from collections.abc import Iterator

from drivers.clock import VirtualClock
from drivers.errors import DeviceFault, DeviceTimeout, LinkLost
from drivers.frame_stream import CAPACITY, FrameStream
from drivers.interfaces import CameraInfo, Frame, OpenContext
from drivers.registry import DriverSpec
from drivers.v4l2_find import Identity, open_node
from drivers.v4l2_node import KernelSystem, System
from drivers.v4l2_session import Session
from drivers.v4l2_settings import V4l2Settings

VIRTUAL = ("vivid", "v4l2 loopback")
SILENCE_S = 1.0
SILENCE_FRAMES = 10


class V4l2Camera:
    """A `Camera`; construct it with `open_camera`.

    It films all the time; `grab` throws away what was exposed before the call. After a camera was unplugged
    the call under way fails; the next one finds the camera again, wherever it was plugged in if it has a
    serial number, and sets it up anew.
    """

    info: CameraInfo

    def __init__(self, settings: V4l2Settings, context: OpenContext, system: System) -> None:
        self._settings = settings
        self._clock = context.clock
        self._system = system
        self._name = f"{context.name} ({settings.device})"
        self._lock = threading.Lock()
        self._stream: FrameStream | None = None
        self._closed = False
        self._identity: Identity | None = None
        self._session: Session | None = self._open()
        self._identity = identity = self._session.identity
        self.info = CameraInfo(
            vendor=identity.vendor or identity.driver,
            model=identity.card,
            serial=identity.serial or identity.bus,
            firmware=identity.firmware,
            simulated=identity.driver in VIRTUAL,
            width_px=settings.width_px,
            height_px=settings.height_px,
            bits=settings.bits,
        )

    def grab(self, timeout_s: float) -> Frame:
        """Return a frame whose exposure began after this call; its flags tell if it is damaged.

        Raises
        ------
        DeviceTimeout
            If there is none after `timeout_s`.
        LinkLost
            If the camera was unplugged.
        DeviceFault
            If it reports errors, another program has changed a setting, or a stream is open.
        """
        asked_s = self._clock.now_s()
        with self._lock:
            session = self._ready("grab")
            with self._forgetting_lost():
                session.drain()
                left_s = asked_s + timeout_s - self._clock.now_s()
                frame = session.next_frame(left_s, after_s=asked_s)
                if frame is not None:
                    session.verify()
                    return frame
        raise DeviceTimeout(
            self._name,
            "grab",
            expected=f"a frame exposed after the call, within {timeout_s:g} s",
            got="none",
            remedy="check cable and power, or allow more time",
        )

    def stream(self, capacity: int = CAPACITY) -> FrameStream:
        """Return a stream of all frames from now on; `grab` is refused until it is closed.

        Parameters
        ----------
        capacity : int
            How many frames may wait for the program.

        Raises
        ------
        DeviceError
            As `grab` does.
        """
        with self._lock:
            session = self._ready("stream")
            begun_s = self._clock.now_s()
            with self._forgetting_lost():
                session.verify()
                session.drain()

            def source(timeout_s: float) -> Frame | None:
                with self._forgetting_lost():
                    return session.next_frame(timeout_s, after_s=begun_s)

            self._stream = FrameStream(
                self._name,
                source,
                self._clock,
                interval_s=session.interval_s,
                silence_s=max(SILENCE_S, SILENCE_FRAMES * session.interval_s),
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
            self._forget()

    def _stream_closed(self) -> None:
        self._stream = None

    def _ready(self, step: str) -> Session:
        if self._closed:
            raise DeviceFault(
                self._name, step, expected="an open camera", got="a closed one", remedy="open it again"
            )
        if self._stream is not None:
            raise DeviceFault(
                self._name,
                step,
                expected="no open stream",
                got="one that takes every frame",
                remedy="take the frame from the stream, or close it",
            )
        if self._session is None:
            self._session = self._open()
        return self._session

    def _open(self) -> Session:
        node, identity = open_node(self._settings.device, self._system, self._name)
        known = self._identity
        if known is not None and not identity.same_camera(known):
            node.close()
            raise LinkLost(
                self._name,
                "find camera again",
                expected=f"{known.card} {known.serial or known.bus}",
                got=f"{identity.card} {identity.serial or identity.bus}",
                remedy="plug the first camera in again, or begin a new run",
            )
        return Session(node, identity, self._settings, self._name, self._clock)

    @contextlib.contextmanager
    def _forgetting_lost(self) -> Iterator[None]:
        try:
            yield
        except LinkLost:
            self._forget()
            raise

    def _forget(self) -> None:
        session, self._session = self._session, None
        if session is not None:
            session.close()


def open_camera(settings: V4l2Settings, context: OpenContext, system: System | None = None) -> V4l2Camera:
    """Open a camera, write its settings, read them back and let it film.

    Parameters
    ----------
    settings : V4l2Settings
    context : OpenContext
    system : System, optional
        This machine's kernel by default.

    Raises
    ------
    DeviceError
        If the camera cannot be opened, or takes a setting differently.
    """
    if system is None:
        if isinstance(context.clock, VirtualClock):
            raise DeviceFault(
                f"{context.name} ({settings.device})",
                "open camera",
                expected="a rig in real time",
                got="simulated time, of which a real camera knows nothing",
                remedy="use driver 'simulated-camera' in a simulated rig",
            )
        system = KernelSystem()
    return V4l2Camera(settings, context, system)


SPEC = DriverSpec(kind="camera", settings=V4l2Settings, open=open_camera)
