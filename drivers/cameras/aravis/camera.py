"""Driver for GigE Vision and USB3 Vision cameras, with the Aravis library (Debian's libaravis-0.8-0)."""

from drivers.cameras.aravis.find import FINDER
from drivers.cameras.aravis.library import Aravis, AravisError, load
from drivers.cameras.aravis.session import AravisSession
from drivers.cameras.aravis.settings import AravisSettings
from drivers.cameras.filming import refuse_simulated_time
from drivers.cameras.genicam.camera import GenicamCamera
from drivers.errors import DeviceError, LinkLost
from drivers.interfaces import CameraInfo, OpenContext
from drivers.registry import DriverSpec


class AravisCamera(GenicamCamera[AravisSession]):
    """A `Camera` through Aravis. To construct this class, call `open_camera`."""

    def __init__(self, settings: AravisSettings, context: OpenContext, library: Aravis) -> None:
        super().__init__(f"{context.name} ({settings.camera})", context.clock)
        self._settings = settings
        self._library = library
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
