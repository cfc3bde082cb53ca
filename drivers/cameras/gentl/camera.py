"""Driver for cameras with a GenTL producer of their maker: Basler, FLIR, IDS, Allied Vision, Teledyne."""

from collections.abc import Callable, Sequence
from contextlib import ExitStack
from typing import Any

from drivers.cameras.filming import OPENING_S, refuse_simulated_time
from drivers.cameras.genicam.camera import GenicamCamera
from drivers.cameras.gentl.device import Device, GentlError
from drivers.cameras.gentl.find import FINDER, chosen, none_of, remedy
from drivers.cameras.gentl.producers import Listed, loaded, producers
from drivers.cameras.gentl.session import GentlSession
from drivers.cameras.gentl.settings import GentlSettings
from drivers.errors import DeviceError, LinkLost
from drivers.interfaces import CameraInfo, OpenContext
from drivers.registry import DriverSpec

VIRTUAL = ("Viky",)
"""Models of the virtual cameras in the package ``genicam``."""


class GentlCamera(GenicamCamera[GentlSession]):
    """A `Camera` of a GenTL producer. To construct this class, call `open_camera`.

    `sources` are the loaded producers, which `close` releases. The first one that finds the camera is used.
    """

    def __init__(self, settings: GentlSettings, context: OpenContext, sources: Sequence[Any]) -> None:
        super().__init__(f"{context.name} ({settings.camera})", context.clock)
        self._settings = settings
        self._sources = list(sources)
        self._known: Listed | None = None
        try:
            # on a thread of its own: on the main thread, Harvesters would take over Ctrl-C
            self._session = self._open_again("open camera", context.clock.now_s() + OPENING_S)
        except BaseException:
            self.close()
            raise
        self.info = self._identity()

    def _let_go(self) -> None:
        while self._sources:
            self._sources.pop().release()

    def _identity(self) -> CameraInfo:
        known, settings = self._known, self._settings
        assert known is not None
        return CameraInfo(
            vendor=known.vendor,
            model=known.model,
            serial=known.serial or known.id,
            simulated=known.model in VIRTUAL,
            width_px=settings.width_px,
            height_px=settings.height_px,
            bits=settings.bits,
        )

    def _open(self) -> GentlSession:
        name = self._settings.camera if self._known is None else self._known.id
        listed: list[Listed] = []

        def choose(cameras: Sequence[Listed]) -> Listed:
            listed.extend(cameras)
            camera = chosen(name, cameras, self._name)
            if camera is None:
                raise LookupError
            return camera

        for source in self._sources:
            try:
                self._known, device = self._connected(source, choose)
            except LookupError:
                continue
            return GentlSession(device, self._settings, self._name, self._clock)
        raise none_of(name, listed, self._name)

    def _connected(self, source: Any, choose: Callable[[Sequence[Listed]], Listed]) -> tuple[Listed, Device]:
        try:
            camera, device = source.connect(choose)
        except GentlError as error:
            remedy = "check cable and power, and that no other program controls the camera"
            raise LinkLost(self._name, "open camera", "a free camera", str(error), remedy) from error
        return camera, device


def open_camera(settings: GentlSettings, context: OpenContext) -> GentlCamera:
    """Open a camera, write its settings, read the settings back and start filming.

    Raise `DeviceError` if the packages or the producer are missing, the camera cannot be opened, or a setting
    reads back differently.
    """
    name = f"{context.name} ({settings.camera})"
    refuse_simulated_time(name, context)
    with ExitStack() as opened:
        sources = []
        try:
            for path in producers(settings.cti):
                sources.append(loaded(path))
                opened.callback(sources[-1].release)
        except ImportError as error:
            expected = "the packages harvesters and genicam"
            raise DeviceError(name, "load Harvesters", expected, str(error), remedy(error)) from error
        except (OSError, GentlError) as error:
            advice = "give the .cti file of the camera's maker as cti, or install the maker's software"
            raise DeviceError(name, "load producer", "a GenTL producer", str(error), advice) from error
        opened.pop_all()
    return GentlCamera(settings, context, sources)


SPEC = DriverSpec(kind="camera", settings=GentlSettings, open=open_camera, find=FINDER)
