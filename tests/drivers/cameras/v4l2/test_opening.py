"""The V4L2 driver opens the wanted camera, or refuses with a clear message."""

import errno

import pytest
from pydantic import ValidationError

from drivers.cameras.v4l2.abi import RequestCode
from drivers.cameras.v4l2.camera import open_camera
from drivers.errors import DeviceError, DeviceFault, DeviceTimeout, LinkLost
from drivers.registry import find_driver
from tests.drivers.cameras.fake_kernel import FakeCamera, FakeSystem
from tests.drivers.cameras.v4l2.opening import opened, settings


def test_says_who_it_is_and_is_found_by_its_name(camera):
    info = camera.info
    assert (info.vendor, info.model, info.serial) == ("Maker", "Mono 12", "A17")
    assert (info.width_px, info.height_px, info.bits, info.simulated) == (32, 20, 12, False)
    assert find_driver("v4l2").kind == "camera"


def test_names_the_camera_by_bus_or_serial_number(plugged, context, clock):
    other = FakeCamera(clock, path="/dev/video1", bus=b"usb-0000:00:14.0-3", serial="B42")
    nodes = [other, plugged]
    # a UVC camera's second node gives metadata, no pictures
    nodes.append(FakeCamera(clock, path="/dev/video2", caps=0x0480_0000))
    for device, serial in [("serial:A17", "A17"), ("bus:usb-0000:00:14.0-3", "B42")]:
        camera = open_camera(settings(device=device), context, FakeSystem(nodes))
        camera.close()
        assert camera.info.serial == serial
    with pytest.raises(LinkLost, match="expected one camera 'serial:C3', got none; plug the camera in"):
        open_camera(settings(device="serial:C3"), context, FakeSystem(nodes))
    other.serial = "A17"
    with pytest.raises(DeviceFault, match=r"got /dev/video1 and /dev/video0; name one of them by its path"):
        open_camera(settings(device="serial:A17"), context, FakeSystem(nodes))
    assert all(node.open_nodes == 0 for node in nodes)


def test_a_node_that_cannot_be_asked_may_be_the_camera_that_is_looked_for(plugged, context):
    plugged.errors[RequestCode.QUERYCAP] = [errno.EIO]
    with pytest.raises(DeviceFault, match=r"identify camera: .*input/output error \(EIO\)"):
        opened(plugged, context, device="serial:A17")


@pytest.mark.parametrize(
    ("request_", "number", "kind", "message"),
    [
        (RequestCode.QUERYCAP, errno.ENOTTY, DeviceFault, "identify camera: expected a camera"),
        (RequestCode.S_PRIORITY, errno.EBUSY, DeviceFault, "claim camera: .*a camera in use"),
        (
            RequestCode.S_FMT,
            errno.EBUSY,
            DeviceFault,
            r"set format: expected 32 x 20 px Y12, .*in use \(EBUSY\)",
        ),
        (RequestCode.S_PARM, errno.ENOTTY, DeviceFault, "set frame rate: expected 32 Hz"),
        (RequestCode.REQBUFS, errno.EBUSY, DeviceFault, "get buffers: .*end the other program"),
        (RequestCode.STREAMON, errno.ENOSPC, DeviceFault, "start: .*too little USB bandwidth"),
        (
            RequestCode.S_CTRL,
            errno.EPIPE,
            DeviceFault,
            r"set auto_exposure: expected 1, got a refusal.*EPIPE",
        ),
        (RequestCode.S_CTRL, errno.EACCES, DeviceFault, "set auto_exposure: .*switch off the automatic"),
        (
            RequestCode.G_CTRL,
            errno.ETIMEDOUT,
            DeviceTimeout,
            r"read auto_exposure: .*no answer \(ETIMEDOUT\)",
        ),
        (RequestCode.QUERYCTRL, errno.EIO, DeviceFault, "list controls: "),
    ],
)
def test_every_error_of_opening_names_step_and_remedy_and_leaves_nothing_open(
    request_, number, kind, message, plugged, context
):
    plugged.errors[request_] = [number]
    with pytest.raises(kind, match=message):
        opened(plugged, context)
    assert (plugged.open_nodes, plugged.mapped) == (0, 0)
    opened(plugged, context).close()


def test_what_the_camera_answers_instead_is_refused(plugged, context):
    for changes, message in [
        ({"width_px": 640}, r"set format: expected 640 x 20 px Y12, got 64 x 20 px Y12"),
        ({"exposure_us": 10_050.0}, r"set exposure: .*got 10050 µs; choose a multiple of 100 µs"),
        ({"exposure_us": None}, r"got no `exposure_us`; add this setting"),
        ({"gain": 101}, r"set gain: expected 0 to 100 in steps of 1, got 101"),
        ({"controls": {"sharpness": 1}}, r"set sharpness: .*where it has auto_exposure, "),
        ({"input": 1}, r"choose input: expected input 1"),
    ]:
        with pytest.raises(DeviceFault, match=message):
            opened(plugged, context, **changes)
    plugged.offers_rate = False
    with pytest.raises(DeviceFault, match="set frame rate: expected 32 Hz, got 25 Hz"):
        opened(plugged, context)
    plugged.offers_rate, plugged.offered = True, ("YUYV", "GREY")
    with pytest.raises(DeviceFault, match="expected 32 x 20 px Y12, got 32 x 20 px YUYV"):
        opened(plugged, context)


def test_too_few_buffers_are_refused(plugged, context):
    plugged.most_buffers = 1
    with pytest.raises(DeviceFault, match="get buffers: expected at least 2, got 1; free memory"):
        opened(plugged, context)


def test_a_closed_camera_and_simulated_time_are_refused(plugged, context):
    camera = opened(plugged, context)
    camera.close()
    with pytest.raises(DeviceFault, match="grab: expected an open camera"):
        camera.grab(1.0)
    with pytest.raises(DeviceFault, match="simulated time"):
        open_camera(settings(), context)


def test_a_rig_file_cannot_ask_for_compression_or_an_exposure_longer_than_a_frame():
    with pytest.raises(ValidationError, match="format"):
        settings(format="MJPG")
    with pytest.raises(ValidationError, match="exposure_us must not be longer than a frame"):
        settings(exposure_us=31_300.0)
    assert issubclass(DeviceFault, DeviceError)


@pytest.mark.parametrize(
    ("key", "value"), [("device", "serial:"), ("device", "bus:"), ("input", 2**32), ("stride_bytes", 2**32)]
)
def test_what_would_be_cut_off_or_mean_any_camera_is_refused(key, value):
    with pytest.raises(ValidationError, match=key):
        settings(**{key: value})
