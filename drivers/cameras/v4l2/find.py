"""List the video nodes of this computer, and find a camera by path, bus or serial number."""

import errno
from dataclasses import dataclass
from pathlib import Path

from drivers.cameras.v4l2.abi import Capability, CapabilityInfo, RequestCode
from drivers.cameras.v4l2.node import Node, System, translating
from drivers.errors import DeviceError, DeviceFault, LinkLost
from drivers.lines.addresses import lasting_names
from drivers.registry import Finder, Found

BUS, SERIAL = "bus:", "serial:"
_NO_CAMERA = (errno.ENOENT, errno.ENODEV, errno.ENXIO, errno.ENOTTY)


@dataclass(frozen=True)
class Identity:
    """Identity of the camera at a device node, unchanged when the camera is plugged into its socket again."""

    driver: str
    card: str
    bus: str
    serial: str
    vendor: str
    firmware: str

    def same_camera(self, other: "Identity") -> bool:
        """Return whether `other` is the same camera. Without serial numbers, the sockets are compared."""
        if self.card != other.card:
            return False
        if self.serial or other.serial:
            return self.serial == other.serial
        return self.bus == other.bus


def video_nodes(root: Path = Path("/")) -> list[Found]:
    """Return the picture node of every camera.

    The path of a node names the socket (``/dev/v4l/by-path``) if the system has such a link, otherwise the
    camera (``/dev/v4l/by-id``). Two cameras of the same model can have the same name in ``by-id``, but they
    are never at the same socket. `root` is the folder that contains the system's folders ``sys`` and ``dev``.
    Tests give another folder.
    """
    lasting = lasting_names(root / "dev/v4l/by-id") | lasting_names(root / "dev/v4l/by-path")
    nodes = []
    for folder in sorted((root / "sys/class/video4linux").glob("video*"), key=_number):
        # take node 0, which delivers the pictures of a camera; its other nodes deliver metadata
        if _content(folder / "index") in ("", "0"):
            node = lasting.get(folder.name, f"/dev/{folder.name}")
            nodes.append(Found(_content(folder / "name"), {"device": node}))
    return nodes


def open_node(wanted: str, system: System, device: str) -> tuple[Node, Identity]:
    """Open the picture node of the camera `wanted`.

    `wanted` is the path of the device node; or ``bus:`` and the camera's bus name; or ``serial:`` and its
    serial number. Raise `LinkLost` if no camera matches `wanted`, and `DeviceFault` if the device cannot be
    opened or is not a camera, or if several cameras match `wanted`.
    """
    if not wanted.startswith((BUS, SERIAL)):
        return _open_path(wanted, system, device)
    found: dict[str, Identity] = {}
    refused: DeviceError | None = None
    for path in system.paths():
        try:
            node, identity = _open_path(path, system, device)
        except DeviceError as error:
            cause = error.__cause__
            if isinstance(cause, OSError) and cause.errno not in _NO_CAMERA:
                refused = error  # keep the error, because this node may belong to the wanted camera
            continue
        node.close()
        if wanted in (BUS + identity.bus, SERIAL + identity.serial):
            found[path] = identity
    if len(found) == 1:
        return _open_path(next(iter(found)), system, device)
    if not found and refused is not None:
        raise refused
    raise (LinkLost if not found else DeviceFault)(
        device,
        "find camera",
        f"one camera {wanted!r}",
        " and ".join(found) or "none",
        "name one of them by its path" if found else "plug the camera in, or correct `device`",
    )


def _open_path(path: str, system: System, device: str) -> tuple[Node, Identity]:
    with translating(device, "open camera", f"a camera at {path}"):
        node = system.open(path)
    try:
        return node, _identify(node, path, system, device)
    except BaseException:
        node.close()
        raise


def _identify(node: Node, path: str, system: System, device: str) -> Identity:
    info = CapabilityInfo()
    with translating(device, "identify camera", "a camera"):
        node.ioctl(RequestCode.QUERYCAP, info)
    # use `device_caps`, because `capabilities` lists the functions of all nodes of the camera together
    own = info.device_caps if info.capabilities & Capability.DEVICE_CAPS else info.capabilities
    needed = Capability.VIDEO_CAPTURE | Capability.STREAMING
    if own & needed != needed:
        kind = "multi-planar camera" if own & Capability.VIDEO_CAPTURE_MPLANE else "node"
        raise DeviceFault(
            device,
            "identify camera",
            "a node that streams single-planar pictures",
            f"a {kind} with capabilities {own:#x}",
            "name another node of the camera",
        )
    facts = system.usb_facts(path)
    version = info.version
    return Identity(
        driver=_text(info.driver),
        card=_text(info.card),
        bus=_text(info.bus_info),
        serial=facts.get("serial", ""),
        vendor=facts.get("manufacturer", ""),
        firmware=facts.get("bcdDevice", "") or f"driver {version >> 16}.{version >> 8 & 255}.{version & 255}",
    )


def _text(raw: bytes) -> str:
    return raw.decode("utf-8", "replace")


def _number(folder: Path) -> int:
    digits = folder.name.removeprefix("video")
    return int(digits) if digits.isdecimal() else 0


def _content(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8", errors="replace").strip()
    except OSError:
        return ""


FINDER = Finder("V4L2 cameras", listed=video_nodes)
