"""Search for GigE Vision and USB3 Vision cameras. Aravis queries every network and every USB bus."""

from drivers.cameras.aravis.library import Aravis, load
from drivers.registry import Finder, Found

PROTOCOLS = ("GigEVision", "USB3Vision")


def vision_cameras(library: Aravis | None = None) -> list[Found]:
    """Return the cameras that answer within one second (Aravis' timeout). No setting is changed.

    `library` is the Aravis library. The default is the library that is installed on this computer. Raise
    `OSError` if the Aravis library is not installed.
    """
    library = _installed() if library is None else library
    library.call("update_device_list")
    cameras = []
    for index in range(library.call("get_n_devices")):
        protocol = library.text("get_device_protocol", index)
        if protocol in PROTOCOLS:
            facts = [library.text(f"get_device_{fact}", index) for fact in ("vendor", "model", "serial_nbr")]
            what = f"{' '.join(facts)} ({protocol} at {library.text('get_device_address', index)})"
            cameras.append(Found(what, {"camera": library.text("get_device_id", index)}))
    return cameras


def _installed() -> Aravis:
    try:
        return load()
    except OSError as error:
        raise OSError(f"no search without Aravis ({error}); apt install libaravis-0.8-0") from error


FINDER = Finder("GigE Vision and USB3 Vision cameras", answering=vision_cameras)
