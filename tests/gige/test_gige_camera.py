"""The GigE Vision driver against another maker's camera: runs `guest_aravis.py` in a network of its own."""

import ctypes
import shutil
import subprocess
import sys

import pytest

from drivers.aravis import open_camera
from drivers.aravis_library import LIBRARIES, load
from drivers.aravis_settings import AravisSettings
from drivers.clock import SystemClock, VirtualClock
from drivers.errors import DeviceError, DeviceFault
from drivers.interfaces import OpenContext

ALONE = ["unshare", "--map-root-user", "--net"]
PATIENCE_S = 150

SETTINGS = AravisSettings(
    camera="192.0.2.7", width_px=64, height_px=64, rate_hz=25.0, exposure_us=1000.0
)  # an address that nobody has


def lacking() -> str | None:
    """Why the test cannot run here."""
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


def test_the_driver_on_a_camera_of_another_maker() -> None:
    reason = lacking()
    if reason:
        pytest.skip(reason)
    tests = f"{sys.executable} -m pytest -p no:cacheprovider -q -s --tb=short tests/gige/guest_aravis.py"
    script = f"PATH=$PATH:/usr/sbin:/sbin; ip link set lo up && exec {tests}"
    done = subprocess.run(
        [*ALONE, "sh", "-c", script], capture_output=True, text=True, timeout=PATIENCE_S, check=False
    )
    print(done.stdout)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "fresh frame at 25 Hz" in done.stdout


def test_a_machine_without_the_library_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    load.cache_clear()
    monkeypatch.setattr("drivers.aravis_library.LIBRARIES", ("libaravis-of-nobody.so.0",))
    with pytest.raises(DeviceError, match=r"load Aravis: .*apt install libaravis-0.8-0"):
        open_camera(SETTINGS, OpenContext("camera", SystemClock()))


def test_simulated_time_is_refused() -> None:
    with pytest.raises(DeviceFault, match="use driver 'simulated-camera' in a simulated rig"):
        open_camera(SETTINGS, OpenContext("camera", VirtualClock()))
