"""Tests of the camera driver with the kernel's `uvcvideo`, and a simulated USB camera on USB/IP.

Each picture contains its number and the true start of its exposure on this machine's clock.
"""

import json
import statistics
import subprocess
import sys
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from drivers.cameras.v4l2.camera import V4l2Camera
from drivers.errors import DeviceFault, DeviceTimeout, LinkLost
from drivers.interfaces import Frame
from drivers.streams.losses import IN_A_ROW, LossKind
from tests.real_cameras.kernel_vm.guest import CLOCK, OPENED, left_open, opened, turn, watched
from tests.real_cameras.kernel_vm.uvc_descriptors import SERIAL
from tests.real_cameras.kernel_vm.uvc_device import NUMBER_BITS, TIME_BITS

EXPOSURE_US = 8000.0
TRANSFER_S = 1 / 30
DEADLINE_S = 40.0


class UsbCamera:
    """A simulated USB camera that is plugged in. `unplug` returns its record of faults and settings."""

    def __init__(self, port: int = 0) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-m", "tests.real_cameras.kernel_vm.uvc_device", str(port)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )

    def tell(self, command: str) -> None:
        assert self._process.stdin is not None
        self._process.stdin.write(command + "\n")
        self._process.stdin.flush()

    def unplug(self) -> dict[str, Any]:
        said, _ = self._process.communicate(timeout=DEADLINE_S)
        return json.loads(said) if said else {}


@pytest.fixture
def usb() -> Iterator[UsbCamera]:
    camera = UsbCamera()
    yield camera
    while OPENED:
        OPENED.pop().close()
    if camera._process.returncode is None:
        camera.unplug()
    assert left_open() == []


def found(**changes: Any) -> V4l2Camera:
    """Open the USB camera as soon as the kernel has found it."""
    values: dict[str, Any] = {
        "device": f"serial:{SERIAL}",
        "width_px": 320,
        "height_px": 240,
        "controls": {},
        "exposure_us": EXPOSURE_US,
        "gain": 0,
    }
    deadline_s = CLOCK.now_s() + DEADLINE_S
    while True:
        try:
            return opened(**(values | changes))
        except LinkLost:
            if CLOCK.now_s() > deadline_s:
                raise
            CLOCK.sleep(0.1)


def written(frame: Frame) -> tuple[int, float]:
    """Return the number and the start of exposure that are written in a picture."""
    bits = frame.image[:2] > frame.image[0].max() // 2
    number = sum(1 << bit for bit in range(NUMBER_BITS) if bits[0, bit])
    return number, sum(1 << bit for bit in range(TIME_BITS) if bits[1, bit]) * 1e-6


def grab_on(camera: V4l2Camera, timeout_s: float) -> None:
    """Grab frames without end, until the camera raises an error."""
    while True:
        camera.grab(timeout_s)


def light(frame: Frame) -> float:
    return float(frame.image[2:].mean())


def test_opens_by_serial_number_with_all_automatics_off(usb: UsbCamera) -> None:
    camera = found(format="Y12", gain=64)
    frame = camera.grab(5.0)
    assert (camera.info.vendor, camera.info.model) == ("Optics of the test", "Mono UVC camera")
    assert (camera.info.serial, camera.info.firmware, camera.info.bits) == (SERIAL, "0107", 12)
    assert 255 < frame.image[2:].max() <= 4095
    assert (frame.exposure_us, frame.gain) == (EXPOSURE_US, 64.0)
    camera.close()
    # exposure by hand, at a fixed rate, 80 times 100 µs; no backlight compensation, gain, no mains filter
    assert usb.unplug()["settings"] == [1, 0, 80, 0, 64, 0]


def test_the_exposure_that_is_set_is_the_one_that_is_filmed(usb: UsbCamera) -> None:
    levels = []
    for exposure_us in (5000.0, 10_000.0, 20_000.0):
        camera = found(format="Y12", exposure_us=exposure_us)
        levels.append(light(camera.grab(5.0)))
        camera.close()
    assert levels == pytest.approx([levels[0], 2 * levels[0], 4 * levels[0]], rel=0.01)


def test_the_exposure_of_every_frame_began_after_the_call(usb: UsbCamera) -> None:
    camera = found()
    seen = watched(camera)
    waits_s, ages_s, middles = [], [], []
    for pause_s in (0.0, 0.01, 0.05, 0.2, 1.5) * 2:
        CLOCK.sleep(pause_s)
        asked_s = CLOCK.now_s()
        frame = camera.grab(5.0)
        waits_s.append(CLOCK.now_s() - asked_s)
        assert frame.flags == 0
        if seen[-1].stamp_s > written(frame)[1] + EXPOSURE_US * 1e-6 + TRANSFER_S:
            continue  # this computer was too slow to send it within the time that the driver counts on
        assert written(frame)[1] >= asked_s
        ages_s.append(written(frame)[1] - frame.exposed_s)
        off_s = frame.middle_s - (written(frame)[1] + EXPOSURE_US * 1e-6 / 2)
        middles.append(off_s / frame.middle_std_s)
        assert abs(middles[-1]) <= 3.0
    print(
        f"USB camera: middle of the exposure {min(middles):.1f} to {max(middles):.1f} standard deviations "
        f"of {frame.middle_std_s * 1e3:.1f} ms from the truth"
    )
    print(
        f"USB camera, fresh frame at 30 Hz: median {statistics.median(waits_s) * 1e3:.0f} ms, "
        f"longest {max(waits_s) * 1e3:.0f} ms; exposure began {min(ages_s) * 1e3:.1f} to "
        f"{max(ages_s) * 1e3:.1f} ms after the time that is given for it; "
        f"{len(ages_s)} of {len(waits_s)} pictures were sent in time"
    )
    assert statistics.median(waits_s) <= 1.5 / 30 + EXPOSURE_US * 1e-6 + TRANSFER_S
    assert len(ages_s) > len(waits_s) // 2
    assert min(ages_s) >= 0.0


def test_every_picture_that_is_missing_is_reported(usb: UsbCamera) -> None:
    camera = found(buffers=16)
    with camera.stream(capacity=1000) as stream:
        frames = [stream.next(5.0) for _ in range(20)]
        for command in ("lose 1", "damage 1", "cut 1", "lose 2", "damage 3"):
            usb.tell(command)
            frames += [stream.next(5.0) for _ in range(20)]
        losses = stream.report().losses
    camera.close()
    spoilt = usb.unplug()["spoilt"]
    shown = [written(frame)[0] for frame in frames]
    bad = {number for numbers in spoilt.values() for number in numbers}
    assert not bad & set(shown)
    assert len(spoilt["damage"]) == 4
    assert len(spoilt["cut"]) == 1
    holes = shown[-1] - shown[0] + 1 - len(shown)
    told = [loss for loss in losses if frames[0].sequence < loss.first <= frames[-1].sequence]
    print(
        f"USB camera: {holes} of {holes + len(shown)} pictures missing: {[loss.kind.name for loss in told]}"
    )
    # those among the last frames are not known yet
    known = shown[-1 - IN_A_ROW] - shown[0] - (len(shown) - 1 - IN_A_ROW)
    assert known <= sum(loss.count for loss in told) <= holes
    assert holes >= 8
    assert sum(loss.kind is LossKind.DAMAGED for loss in told) == 5


def test_a_stalled_camera_is_given_up_in_time_and_taken_again(usb: UsbCamera) -> None:
    camera = found()
    camera.grab(5.0)
    usb.tell("stall 1")
    with pytest.raises(DeviceTimeout):
        grab_on(camera, 0.5)
    usb.tell("stall 0")
    assert camera.grab(5.0).flags == 0


def test_a_refused_setting_and_an_exposure_in_the_hands_of_an_automatic(usb: UsbCamera) -> None:
    found().close()
    usb.tell("refuse 1")
    with pytest.raises(DeviceFault, match=r"set \w+: expected .*\((ERANGE|EPIPE)\); choose a value"):
        found(gain=7)
    assert left_open() == []
    usb.tell("refuse 0")
    camera = found(gain=7)
    with pytest.raises(OSError, match="busy"):
        turn("Gain", 3, path=camera._system.paths()[2])
    camera.close()


def test_unplugged_it_is_found_again_at_another_socket(usb: UsbCamera) -> None:
    camera = found()
    before = camera.grab(5.0)
    usb.unplug()
    with pytest.raises(LinkLost, match=r"(get frame|verify \w+|read \w+): .*unplugged camera \(ENODEV\)"):
        grab_on(camera, 5.0)
    with pytest.raises(LinkLost, match="got none; plug the camera in"):
        camera.grab(5.0)
    again = UsbCamera(port=1)
    deadline_s = CLOCK.now_s() + DEADLINE_S
    while True:
        try:
            after = camera.grab(5.0)
            break
        except LinkLost:
            assert CLOCK.now_s() < deadline_s
            CLOCK.sleep(0.1)
    camera.close()
    # set up anew: exposure, gain and all
    assert again.unplug()["settings"] == [1, 0, 80, 0, 0, 0]
    assert light(after) == pytest.approx(light(before), rel=0.01)
    assert np.array_equal(after.image[2:], before.image[2:])
