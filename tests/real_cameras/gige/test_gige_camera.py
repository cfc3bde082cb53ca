"""Run `guest_*.py`, which test the GigE Vision driver with Aravis' fake camera, in a separate network."""

import ctypes
import shutil
import subprocess
import sys

import pytest

from drivers.cameras.aravis.camera import open_camera
from drivers.cameras.aravis.library import LIBRARIES, load
from drivers.cameras.aravis.settings import AravisSettings
from drivers.clock import SystemClock, VirtualClock
from drivers.errors import DeviceError, DeviceFault
from drivers.interfaces import OpenContext
from tests.drivers.cameras.fake_aravis import MISSING_PACKETS

ALONE = ["unshare", "--map-root-user", "--net"]
DEADLINE_S = 300

SETTINGS = AravisSettings(
    camera="192.0.2.7", width_px=64, height_px=64, rate_hz=25.0, exposure_us=1000.0
)  # an address that nobody has


def lacking() -> str | None:
    """Return the reason why the test cannot run on this computer, or None."""
    if shutil.which("arv-fake-gv-camera-0.8") is None:
        return "install aravis-tools for a GigE Vision camera to test against"
    try:
        for name in LIBRARIES:
            ctypes.CDLL(name)
    except OSError as error:
        return f"install libaravis-0.8-0: {error}"
    if shutil.which("ip", path="/usr/sbin:/sbin:/usr/bin:/bin") is None:
        return "install iproute2 for a network of the test's own"
    try:
        subprocess.run([*ALONE, "true"], check=True, capture_output=True, timeout=30)
    except (OSError, subprocess.CalledProcessError) as error:
        return f"no network of the test's own can be made here: {error}"
    return None


@pytest.mark.long
@pytest.mark.timeout(2 * DEADLINE_S)
def test_the_driver_on_a_camera_of_another_maker() -> None:
    reason = lacking()
    if reason:
        pytest.skip(reason)
    guests = " ".join(f"tests/real_cameras/gige/guest_{name}.py" for name in ("aravis", "contract", "run"))
    tests = f"{sys.executable} -m pytest -p no:cacheprovider -q -s -rA --tb=short {guests}"
    script = f"PATH=$PATH:/usr/sbin:/sbin; ip link set lo up && exec {tests}"
    done = subprocess.run(
        [*ALONE, "sh", "-c", script], capture_output=True, text=True, timeout=DEADLINE_S, check=False
    )
    print(done.stdout)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "fresh frame at 25 Hz" in done.stdout
    for what in ("acquisition from", "pull before", "live gauge in the frames of"):
        assert f"{what} Aravis' camera" in done.stdout
    assert "PASSED tests/real_cameras/gige/guest_contract.py" in done.stdout


class EnumValue(ctypes.Structure):
    """``GEnumValue`` of GObject"""

    _fields_ = (("value", ctypes.c_int), ("name", ctypes.c_char_p), ("nick", ctypes.c_char_p))


def test_the_status_of_missing_packets_is_the_librarys_own() -> None:
    try:
        aravis, gobject, _ = [ctypes.CDLL(name) for name in LIBRARIES]
    except OSError as error:
        pytest.skip(f"install libaravis-0.8-0: {error}")
    aravis.arv_buffer_status_get_type.restype = ctypes.c_size_t
    gobject.g_type_class_ref.restype = ctypes.c_void_p
    gobject.g_type_class_ref.argtypes = (ctypes.c_size_t,)
    by_name = gobject.g_enum_get_value_by_name
    by_name.restype, by_name.argtypes = ctypes.POINTER(EnumValue), (ctypes.c_void_p, ctypes.c_char_p)
    statuses = gobject.g_type_class_ref(aravis.arv_buffer_status_get_type())
    assert by_name(statuses, b"ARV_BUFFER_STATUS_MISSING_PACKETS").contents.value == MISSING_PACKETS


def test_a_machine_without_the_library_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    load.cache_clear()
    monkeypatch.setattr("drivers.cameras.aravis.library.LIBRARIES", ("libaravis-of-nobody.so.0",))
    with pytest.raises(DeviceError, match=r"load Aravis: .*apt install libaravis-0.8-0"):
        open_camera(SETTINGS, OpenContext("camera", SystemClock()))


def test_simulated_time_is_refused() -> None:
    with pytest.raises(DeviceFault, match="use driver 'simulated-camera' in a simulated rig"):
        open_camera(SETTINGS, OpenContext("camera", VirtualClock()))
