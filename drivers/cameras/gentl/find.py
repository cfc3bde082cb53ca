"""Choose a camera by what its producer tells about it, and search for cameras with all known producers."""

import sys
from collections.abc import Sequence

from drivers.cameras.gentl.device import GentlError
from drivers.cameras.gentl.producers import Listed, loaded, producers
from drivers.errors import DeviceFault, LinkLost
from drivers.registry import Finder, Found

INSTALL = "pip install 'offaxis[gentl]'"


def remedy(error: ImportError) -> str:
    """Return what to install, such as Python's shared library, which a system's own Python may lack."""
    if "libpython" in str(error):
        library = f"libpython{sys.version_info.major}.{sys.version_info.minor}"
        return f"install Python's shared library, on Debian and Ubuntu: sudo apt install {library}"
    return INSTALL


def chosen(name: str, listed: Sequence[Listed], device: str) -> Listed | None:
    """Return the camera with a serial number, identifier, own name or model; None if there is none.

    Raise `DeviceFault` if several cameras are called so.
    """
    called = [camera for camera in listed if camera.is_called(name)]
    if len(called) > 1:
        serials = ", ".join(camera.serial for camera in called)
        raise DeviceFault(
            device,
            "find camera",
            "one camera of this name",
            f"{len(called)}, with the serial numbers {serials}",
            "give the serial number as camera",
        )
    return called[0] if called else None


def none_of(name: str, listed: Sequence[Listed], device: str) -> LinkLost:
    """Return the error that no producer finds the camera."""
    others = ", ".join(f"{camera.model} {camera.serial}" for camera in listed)
    return LinkLost(
        device,
        "find camera",
        f"the camera {name!r}",
        f"only {others}" if others else "no camera at all",
        "check cable, power and address, and `cti`; rig devices lists the cameras that are found",
    )


def gentl_cameras() -> list[Found]:
    """Return the cameras that the producers of GENICAM_GENTL64_PATH find. No setting is changed.

    Raise `OSError` if there is no producer, or the packages are not installed.
    """
    found: dict[str, Found] = {}
    try:
        for path in producers([]):
            producer = loaded(path)
            try:
                cameras = producer.listed()
            finally:
                producer.release()
            for each in cameras:
                what = f"{each.vendor} {each.model} {each.serial} ({each.kind})"
                found.setdefault(what, Found(what, {"camera": each.serial or each.id, "cti": path}))
    except ImportError as error:
        raise OSError(f"no search without Harvesters ({error}); {remedy(error)}") from error
    except GentlError as error:
        raise OSError(f"no search: {error}") from error
    return list(found.values())


FINDER = Finder("cameras with a GenTL producer", answering=gentl_cameras)
