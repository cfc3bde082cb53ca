"""Driver for cameras on the camera interface of Linux (V4L2), with full bit depth and checked settings.

The driver uses the kernel directly and needs no library. docs/cameras.md describes weaknesses of V4L2, such
as silently changed settings, and the driver's checks against them.
"""

from drivers.cameras.filming import FilmingCamera, refuse_simulated_time
from drivers.cameras.v4l2.find import FINDER, Identity, open_node
from drivers.cameras.v4l2.node import System
from drivers.cameras.v4l2.session import V4l2Session
from drivers.cameras.v4l2.settings import V4l2Settings
from drivers.errors import LinkLost
from drivers.interfaces import CameraInfo, OpenContext
from drivers.registry import DriverSpec

VIRTUAL = ("vivid", "v4l2 loopback")


class V4l2Camera(FilmingCamera[V4l2Session]):
    """A `Camera` on V4L2. To construct this class, call `open_camera`.

    When the camera is unplugged, the running call fails with `LinkLost`. The next call searches for the
    camera and configures it again. If the rig file gives the camera by serial number, the camera may be
    plugged into another socket.
    """

    def __init__(self, settings: V4l2Settings, context: OpenContext, system: System) -> None:
        super().__init__(f"{context.name} ({settings.device})", context.clock)
        self._settings = settings
        self._system = system
        self._identity: Identity | None = None
        self._session = self._open()
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

    def _open_again(self, step: str, deadline_s: float) -> V4l2Session:
        return self._open()

    def _open(self) -> V4l2Session:
        node, identity = open_node(self._settings.device, self._system, self._name)
        known = self._identity
        if known is not None and not identity.same_camera(known):
            node.close()
            raise LinkLost(
                self._name,
                "find camera again",
                f"{known.card} {known.serial or known.bus}",
                f"{identity.card} {identity.serial or identity.bus}",
                "plug the first camera in again, or begin a new run",
            )
        return V4l2Session(node, identity, self._settings, self._name, self._clock)


def open_camera(settings: V4l2Settings, context: OpenContext, system: System | None = None) -> V4l2Camera:
    """Open a camera, write its settings, read the settings back and start filming.

    `system` is the system that provides the device nodes. The default is the kernel of this computer. Raise
    `DeviceError` if the camera cannot be opened, or a setting reads back differently.
    """
    if system is None:
        refuse_simulated_time(f"{context.name} ({settings.device})", context)
        system = System()
    return V4l2Camera(settings, context, system)


SPEC = DriverSpec(kind="camera", settings=V4l2Settings, open=open_camera, find=FINDER)
