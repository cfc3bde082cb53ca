"""The driver `gentl` with the three virtual cameras of the package genicam, through its producer viky.cti.

They film in real time, so the limits leave room for a busy computer. They have no exposure time, no gain, no
time stamps and no lines.
"""

import math
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import ExitStack, closing
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from drivers.cameras.gentl.camera import GentlCamera, open_camera
from drivers.cameras.gentl.find import gentl_cameras
from drivers.cameras.gentl.settings import GentlSettings
from drivers.clock import SystemClock
from drivers.errors import DeviceError, DeviceFault, LinkLost
from drivers.interfaces import OpenContext
from drivers.testing import CameraBench, CameraContract

REASON = "pip install 'offaxis[gentl]' and Python's shared library for the virtual cameras of genicam 1.6"
genicam = pytest.importorskip("genicam", reason=REASON)
# It fails to load where a system's Python comes without libpython.
pytest.importorskip("harvesters.core", reason=REASON, exc_type=ImportError)
PRODUCER = Path(genicam.__file__).with_name("viky.cti")
if not PRODUCER.exists():
    pytest.skip(REASON, allow_module_level=True)

CLOCK = SystemClock()
GRAB_S = 20.0
RATE_HZ = 50.0
SERIALS = ("0", "1", "2")


def opened(serial: str, **changes: object) -> GentlCamera:
    values = {
        "camera": serial,
        "cti": str(PRODUCER),
        "width_px": 160,
        "height_px": 120,
        "rate_hz": RATE_HZ,
        "transfer_us": 0.0,
    }
    settings = GentlSettings.model_validate(values | changes)
    return open_camera(settings, OpenContext(f"camera {serial}", CLOCK))


@pytest.mark.parametrize("serial", SERIALS)
class TestVirtualCamera(CameraContract):
    @pytest.fixture
    def bench(self, serial: str) -> Iterator[CameraBench]:
        with closing(opened(serial)) as camera:
            yield CameraBench(
                camera,
                CLOCK,
                f"camera {serial}",
                interval_s=1 / RATE_HZ,
                reopen=partial(opened, serial),
                tolerance_s=1.0,
            )


def test_three_cameras_of_one_producer_film_at_once_and_account_for_every_frame() -> None:
    with ExitStack() as end:
        streams = [
            end.enter_context(closing(opened(serial, buffers=32))).stream(capacity=1000) for serial in SERIALS
        ]
        numbers = [[stream.next(GRAB_S).sequence for _ in range(60)] for stream in streams]
    for each, stream in zip(numbers, streams, strict=True):
        lost = {loss.first + i for loss in stream.report().losses for i in range(loss.count)}
        assert set(range(each[0], each[-1])) - set(each) <= lost
        assert each == sorted(set(each))


def test_what_these_cameras_do_not_tell_is_unknown_and_limits_hold() -> None:
    with closing(opened("1", transfer_us=None)) as camera:
        asked_s = CLOCK.now_s()
        frame = camera.grab(GRAB_S)
    assert camera.info.simulated
    assert np.isnan([frame.exposure_us, frame.gain, frame.middle_s, frame.middle_std_s]).all()
    # one frame time each for an exposure and a transfer that nobody tells
    assert frame.received_s - frame.exposed_s >= 2 / RATE_HZ
    assert frame.exposed_s >= asked_s
    middle_s, std_s = frame.middle
    assert frame.exposed_s < middle_s < frame.received_s
    assert std_s == pytest.approx((frame.received_s - frame.exposed_s) / math.sqrt(12))


def test_a_picture_that_waited_is_not_taken() -> None:
    with closing(opened("0")) as camera:
        before = camera.grab(GRAB_S)
        # all eight buffers are full of pictures from the beginning of the pause
        CLOCK.sleep(0.5)
        after = camera.grab(GRAB_S)
    apart = (after.received_s - before.received_s) * RATE_HZ
    assert after.sequence - before.sequence > apart / 2


@pytest.mark.parametrize(
    ("serial", "changes", "error", "message"),
    [
        ("Viky", {}, DeviceFault, "got 3, with the serial numbers 0, 1, 2"),
        ("7", {}, LinkLost, "expected the camera '7', got only Viky 0, Viky 1, Viky 2"),
        ("1", {"exposure_us": 100.0}, DeviceFault, "leave out exposure_us"),
        ("1", {"gain": 1.0}, DeviceFault, "leave out gain"),
        (
            "1",
            {"format": "Mono12"},
            DeviceFault,
            "cannot convert value 'Mono12', the value is invalid.; choose",
        ),
        ("1", {"rate_hz": 500.0}, DeviceFault, "must be smaller than or equal 200"),
        (
            "1",
            {"offset_x_px": 8},
            DeviceFault,
            r"px at \(8, 0\), got 160 x 120 px at \(0, 0\)",
        ),
        ("1", {"trigger": "Line1"}, DeviceFault, "expected a camera with TriggerMode, got none"),
        ("1", {"output": "Line1"}, DeviceFault, "expected a camera with LineSelector, got none"),
        ("1", {"stamp": "start"}, DeviceFault, "leave out `stamp`"),
        ("1", {"cti": "/no/such.cti"}, DeviceError, "load producer: .* got no such file: /no/such.cti"),
    ],
)
def test_what_a_camera_does_not_take_is_refused_in_one_sentence(serial, changes, error, message) -> None:
    with pytest.raises(error, match=message) as refused:
        opened(serial, **changes)
    assert "\n" not in str(refused.value)
    opened("1").close()


def test_a_camera_in_other_hands_is_told() -> None:
    with (
        closing(opened("2")),
        pytest.raises(LinkLost, match=r"a free camera, got .* already in use"),
    ):
        opened("2")


def test_the_driver_leaves_ctrl_c_alone() -> None:
    before = signal.getsignal(signal.SIGINT)
    assert threading.current_thread() is threading.main_thread()
    opened("0").close()
    assert signal.getsignal(signal.SIGINT) is before


def test_cameras_are_found_by_their_serial_numbers(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("GENICAM_GENTL64_PATH", str(PRODUCER.parent))
    found = gentl_cameras()
    assert [each.place for each in found] == list(SERIALS)
    assert found[0].what == "Machine Vision Games Ltd. Viky 0 (Custom)"
    with closing(opened("", **found[1].settings)) as camera:
        assert camera.info.serial == "1"


def test_a_search_does_not_disturb_a_camera_that_films(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("GENICAM_GENTL64_PATH", str(PRODUCER.parent))
    with closing(opened("0")) as camera, camera.stream() as stream:
        first = stream.next(GRAB_S)
        assert len(gentl_cameras()) == len(SERIALS)
        later = [stream.next(GRAB_S).sequence for _ in range(5)]
    assert first.sequence < later[0] <= later[-1] - 4


def test_a_program_that_forgets_to_close_ends_all_the_same() -> None:
    script = "from tests.real_cameras.gentl.test_virtual_cameras import opened; c = opened('1'); c.grab(20.0)"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stderr) == (0, "")
