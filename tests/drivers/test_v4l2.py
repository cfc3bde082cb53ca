import errno
import os
from collections.abc import Iterator

import numpy as np
import pytest
from pydantic import ValidationError

from drivers.clock import VirtualClock
from drivers.errors import DeviceError, DeviceFault, DeviceTimeout, LinkLost
from drivers.interfaces import OpenContext
from drivers.registry import find_driver
from drivers.v4l2 import V4l2Camera, open_camera
from drivers.v4l2_abi import BufferFlag, ControlFlag, ControlId, Request
from drivers.v4l2_node import KernelNode
from drivers.v4l2_session import SHORT
from drivers.v4l2_settings import V4l2Settings
from tests.drivers.fake_kernel import FakeCamera, FakeControl, FakeNode, FakeSystem

EXPOSURE_US = 10_000.0


def settings(**changes: object) -> V4l2Settings:
    values = {
        "device": "/dev/video0",
        "format": "Y12",
        "width_px": 32,
        "height_px": 20,
        "rate_hz": 32.0,
        "exposure_us": EXPOSURE_US,
        "gain": 4,
        "transfer_us": 0.0,
    }
    return V4l2Settings.model_validate(values | changes)


@pytest.fixture
def clock() -> VirtualClock:
    clock = VirtualClock()
    clock.sleep(100.0)
    return clock


@pytest.fixture
def plugged(clock: VirtualClock) -> Iterator[FakeCamera]:
    camera = FakeCamera(clock)
    yield camera
    assert camera.open_nodes == 0
    assert camera.mapped == 0


def opened(plugged: FakeCamera, context: OpenContext, **changes: object) -> V4l2Camera:
    return open_camera(settings(**changes), context, FakeSystem([plugged]))


@pytest.fixture
def camera(plugged: FakeCamera, context: OpenContext) -> Iterator[V4l2Camera]:
    camera = opened(plugged, context)
    yield camera
    camera.close()
    camera.close()


def number_of(image: np.ndarray, mask: int = 0xFFF, most: int = 5000) -> int:
    """Which picture a frame shows."""
    levels = {(number * 37 + 11) & mask: number for number in range(min(most, mask // 37))}
    assert image.min() == image.max()
    return levels[int(image[0, 0])]


def test_says_who_it_is_and_is_found_by_its_name(camera):
    info = camera.info
    assert (info.vendor, info.model, info.serial) == ("Maker", "Mono 12", "A17")
    assert (info.width_px, info.height_px, info.bits, info.simulated) == (32, 20, 12, False)
    assert find_driver("v4l2").kind == "camera"


@pytest.mark.parametrize("padding", [0, 24])
@pytest.mark.parametrize(
    ("code", "bits", "dtype"),
    [
        ("GREY", 8, np.uint8),
        ("Y10", 10, np.uint16),
        ("Y12", 12, np.uint16),
        ("Y16", 16, np.uint16),
        ("YUYV", 8, np.uint8),
    ],
)
def test_every_format_arrives_at_full_depth_without_its_padding(code, bits, dtype, padding, plugged, context):
    plugged.padding, plugged.level_mask = padding, (1 << bits) - 1
    camera = opened(plugged, context, format=code)
    try:
        frame = camera.grab(1.0)
    finally:
        camera.close()
    assert camera.info.bits == bits
    assert (frame.image.dtype, frame.image.shape) == (dtype, (20, 32))
    assert frame.image.flags.c_contiguous
    assert np.unique(frame.image).tolist() == [((plugged.shown - 1) * 37 + 11) & (1 << bits) - 1]


def test_switches_every_automatic_off_and_reads_back(camera, plugged):
    controls = plugged.controls
    for automatic, off in [
        (ControlId.EXPOSURE_AUTO, 1),
        (ControlId.EXPOSURE_AUTO_PRIORITY, 0),
        (ControlId.AUTO_WHITE_BALANCE, 0),
        (ControlId.POWER_LINE_FREQUENCY, 0),
    ]:
        assert controls[automatic].value == off
    assert controls[ControlId.EXPOSURE_ABSOLUTE].value == 100  # of 100 µs each, by the kernel's documentation
    frame = camera.grab(1.0)
    assert (frame.exposure_us, frame.gain) == (EXPOSURE_US, 4.0)


@pytest.mark.parametrize("pause_s", [0.0, 0.01, 0.5, 3600.0])
def test_a_frame_was_exposed_after_the_call_whatever_the_pause(pause_s, camera, clock):
    camera.grab(1.0)
    for phase in range(8):
        clock.sleep(pause_s + phase / 256)
        asked_s = clock.now_s()
        frame = camera.grab(1.0)
        assert frame.exposed_s >= asked_s
        assert frame.received_s - asked_s <= 1.5 / 32 + EXPOSURE_US * 1e-6 + 1 / 256 + 0.5 / 32


def test_the_stamp_of_a_usb_camera_is_the_first_packets_not_the_exposures(plugged, context):
    exposure_s = EXPOSURE_US * 1e-6
    for driver, transfer_us, early_s in [
        (b"uvcvideo", 0.0, exposure_s),
        (b"uvcvideo", 7000.0, exposure_s + 0.007),
        (b"uvcvideo", None, exposure_s + 1 / 32),
        (b"imx", None, 0.0),
    ]:
        plugged.driver = driver
        camera = opened(plugged, context, transfer_us=transfer_us)
        try:
            frame = camera.grab(1.0)
        finally:
            camera.close()
        stamp_s = plugged.begun_s + frame.sequence / 32
        assert frame.exposed_s == pytest.approx(stamp_s - early_s, abs=2e-6)


def test_a_stamp_at_the_end_counts_exposure_and_readout_back(plugged, context):
    plugged.stamp = BufferFlag.MONOTONIC
    plugged.stamp_offset_s = 1 / 32
    for transfer_us, back_s in ((None, 1 / 32), (5000.0, 0.005)):
        camera = opened(plugged, context, transfer_us=transfer_us)
        try:
            frame = camera.grab(1.0)
        finally:
            camera.close()
        stamp_s = plugged.begun_s + (frame.sequence + 1) / 32
        assert frame.exposed_s == pytest.approx(stamp_s - EXPOSURE_US * 1e-6 - back_s, abs=2e-6)


def test_the_date_belongs_to_the_exposure(camera, clock):
    frame = camera.grab(1.0)
    age_s = (clock.utc() - frame.utc).total_seconds()
    assert age_s == pytest.approx(clock.now_s() - frame.exposed_s, abs=2e-6)


def test_a_damaged_and_a_short_frame_carry_flags(plugged, context):
    plugged.frame_faults = dict.fromkeys(range(2, 40), "damaged") | dict.fromkeys(range(40, 80), "short")
    camera = opened(plugged, context)
    try:
        frame = camera.grab(1.0)
        assert frame.flags == BufferFlag.ERROR
        while plugged.shown < 45:
            frame = camera.grab(1.0)
        assert frame.flags == SHORT
        assert (frame.image[10:] == 0).all()
        assert (frame.image[:10] == (plugged.shown - 1) * 37 + 11).all()
    finally:
        camera.close()


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


def test_an_unplugged_camera_is_found_again_at_another_socket(plugged, context):
    camera = opened(plugged, context, device="serial:A17")
    try:
        camera.grab(1.0)
        plugged.present = False
        with pytest.raises(
            LinkLost, match=r"device \(serial:A17\): get frame: .*unplugged camera \(ENODEV\)"
        ):
            camera.grab(1.0)
        assert (plugged.open_nodes, plugged.mapped) == (0, 0)
        with pytest.raises(LinkLost, match="got none; plug the camera in"):
            camera.grab(1.0)
        plugged.present, plugged.path, plugged.bus = True, "/dev/video3", b"usb-0000:00:14.0-9"
        plugged.controls[ControlId.EXPOSURE_AUTO].value = 3
        plugged.controls[ControlId.GAIN].value = 99
        frame = camera.grab(1.0)
        assert frame.flags == 0
        assert plugged.controls[ControlId.GAIN].value == 4
    finally:
        camera.close()


def test_another_camera_at_the_same_path_is_not_taken_for_the_first(plugged, context):
    camera = opened(plugged, context)
    try:
        plugged.present = False
        with pytest.raises(LinkLost):
            camera.grab(1.0)
        plugged.present, plugged.serial = True, "B42"
        with pytest.raises(LinkLost, match="expected Mono 12 A17, got Mono 12 B42"):
            camera.grab(1.0)
    finally:
        camera.close()


def test_a_stalled_camera_is_given_up_at_the_deadline_and_taken_again(camera, plugged, clock):
    plugged.stalled = True
    asked_s = clock.now_s()
    with pytest.raises(DeviceTimeout, match=r"grab: expected a frame exposed after the call, within 0.5 s"):
        camera.grab(0.5)
    assert clock.now_s() - asked_s == pytest.approx(0.5, abs=0.01)
    plugged.stalled = False
    assert camera.grab(1.0).flags == 0


def test_one_stream_error_is_healed_and_a_lasting_one_reported(camera, plugged):
    camera.grab(1.0)
    plugged.errors[Request.DQBUF] = [errno.EIO]
    first = camera.grab(1.0)
    assert first.flags == 0
    plugged.errors[Request.DQBUF] = [errno.EIO] * 9
    with pytest.raises(DeviceFault, match=r"get frame: expected a frame, got an input/output error \(EIO\)"):
        camera.grab(1.0)
    plugged.errors.clear()
    assert camera.grab(1.0).sequence > first.sequence


def test_a_buffer_that_the_kernel_refused_is_offered_again(camera, plugged):
    plugged.errors[Request.QBUF] = [errno.EAGAIN, errno.ENOMEM, errno.EINTR]
    for _ in range(6):
        camera.grab(1.0)
    plugged.pass_time()
    assert len(plugged.queued) + len(plugged.filled) == 4


@pytest.mark.parametrize(
    ("request_", "number", "kind", "message"),
    [
        (Request.QUERYCAP, errno.ENOTTY, DeviceFault, "identify camera: expected a camera"),
        (Request.S_PRIORITY, errno.EBUSY, DeviceFault, "claim camera: .*a camera in use"),
        (Request.S_FMT, errno.EBUSY, DeviceFault, r"set format: expected 32 x 20 px Y12, .*in use \(EBUSY\)"),
        (Request.S_PARM, errno.ENOTTY, DeviceFault, "set frame rate: expected 32 Hz"),
        (Request.REQBUFS, errno.EBUSY, DeviceFault, "get buffers: .*end the other program"),
        (Request.STREAMON, errno.ENOSPC, DeviceFault, "start: .*too little USB bandwidth"),
        (Request.S_CTRL, errno.EPIPE, DeviceFault, r"set auto_exposure: expected 1, got a refusal.*EPIPE"),
        (Request.S_CTRL, errno.EACCES, DeviceFault, "set auto_exposure: .*switch off the automatic"),
        (Request.G_CTRL, errno.ETIMEDOUT, DeviceTimeout, r"read auto_exposure: .*no answer \(ETIMEDOUT\)"),
        (Request.QUERYCTRL, errno.EIO, DeviceFault, "list controls: "),
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
        ({"exposure_us": None}, r"got no `exposure_us`; add it"),
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


def test_a_control_that_keeps_another_value_is_refused_unless_it_is_accepted(plugged, context):
    plugged.controls[ControlId.POWER_LINE_FREQUENCY].keeps = 1
    with pytest.raises(DeviceFault, match="set power_line_frequency: expected 0, got 1 on reading back"):
        opened(plugged, context)
    opened(plugged, context, controls={"power_line_frequency": 1}).close()
    plugged.controls[ControlId.BACKLIGHT_COMPENSATION] = FakeControl(
        "Backlight Compensation", 1, flags=ControlFlag.READ_ONLY
    )
    with pytest.raises(DeviceFault, match=r"accept it: controls = \{ backlight_compensation = 1 \}"):
        opened(plugged, context, controls={"power_line_frequency": 1})


def test_a_sensor_that_counts_lines_needs_their_duration(plugged, context):
    plugged.controls = {ControlId.EXPOSURE: FakeControl("Exposure", 7, 4, 4000)}
    with pytest.raises(DeviceFault, match="got exposure in lines; add `line_us`"):
        opened(plugged, context, gain=None)
    with pytest.raises(DeviceFault, match="got no gain control"):
        opened(plugged, context, line_us=20.0)
    camera = opened(plugged, context, gain=None, line_us=20.0)
    frame = camera.grab(1.0)
    camera.close()
    assert plugged.controls[ControlId.EXPOSURE].value == 500
    assert frame.exposure_us == EXPOSURE_US
    assert np.isnan(frame.gain)


def test_a_setting_that_another_program_changes_is_noticed(camera, plugged):
    camera.grab(1.0)
    plugged.controls[ControlId.GAIN].value = 5
    with pytest.raises(DeviceFault, match="verify gain: expected 4, as it was set, got 5"):
        camera.grab(1.0)


def test_stamps_and_grey_levels_that_cannot_be_are_refused(plugged, context):
    for change, message in [
        ({"stamp": 0}, "expected a stamp of the monotonic clock"),
        ({"stamp_offset_s": 9.0}, "expected a frame from the past"),
        ({"level_mask": 0xFFFF, "shown": 200}, "expected grey levels of 12 bits"),
    ]:
        before = {name: getattr(plugged, name) for name in change}
        for name, value in change.items():
            setattr(plugged, name, value)
        camera = opened(plugged, context)
        try:
            with pytest.raises(DeviceFault, match=message):
                camera.grab(1.0)
        finally:
            camera.close()
        for name, value in before.items():
            setattr(plugged, name, value)


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


def test_buffers_that_were_all_refused_are_offered_again(camera, plugged):
    def grab_on() -> None:
        while True:
            camera.grab(0.5)

    plugged.errors[Request.QBUF] = [errno.ENOMEM] * 100_000
    with pytest.raises(DeviceTimeout):
        grab_on()
    assert not plugged.queued
    plugged.errors.clear()
    assert camera.grab(1.0).flags == 0


def test_a_stream_that_could_not_be_restarted_is_tried_again_at_the_next_call(camera, plugged):
    camera.grab(1.0)
    plugged.errors = {Request.DQBUF: [errno.EIO], Request.STREAMON: [errno.EIO]}
    with pytest.raises(DeviceFault, match=r"input/output error \(EIO\)"):
        camera.grab(1.0)
    assert camera.grab(1.0).flags == 0


def test_what_has_a_setting_of_its_own_is_no_further_control(plugged, context):
    for name, own in (("exposure_time_absolute", "exposure_us"), ("gain", "gain")):
        with pytest.raises(DeviceFault, match=f"set {name}: .*under `controls`; say it by `{own}`"):
            opened(plugged, context, controls={name: 50})


def test_an_automatic_that_is_named_is_set_before_what_it_holds(plugged, context):
    camera = opened(plugged, context, controls={"auto_exposure": 1})
    assert camera.grab(1.0).exposure_us == EXPOSURE_US
    camera.close()


def test_an_automatic_that_cannot_be_changed_may_be_accepted(plugged, context):
    plugged.controls[ControlId.BACKLIGHT_COMPENSATION] = FakeControl(
        "Backlight Compensation", 1, flags=ControlFlag.READ_ONLY
    )
    opened(plugged, context, controls={"backlight_compensation": 1}).close()


def test_a_control_that_an_automatic_holds_is_not_called_set(plugged, context):
    plugged.controls[ControlId.GAIN].flags = ControlFlag.INACTIVE
    with pytest.raises(DeviceFault, match="set gain: expected 4 in effect, got a control that an automatic"):
        opened(plugged, context)
    camera = opened(plugged, context, gain=None)
    assert np.isnan(camera.grab(1.0).gain)
    plugged.controls[ControlId.GAIN].value = 7  # as the automatic does
    assert np.isnan(camera.grab(1.0).gain)
    camera.close()


def test_a_value_that_the_camera_does_not_know_is_named(plugged, context):
    plugged.errors[Request.S_CTRL] = [errno.EINVAL]
    with pytest.raises(DeviceFault, match=r"set auto_exposure: .*EINVAL\); choose a value that the camera"):
        opened(plugged, context)


def test_rows_of_another_stride_than_asked_for_are_refused(plugged, context):
    with pytest.raises(DeviceFault, match="set stride: expected rows of 128 bytes, got rows of 64"):
        opened(plugged, context, stride_bytes=128)
    opened(plugged, context, stride_bytes=64).close()


@pytest.mark.parametrize(
    ("key", "value"), [("device", "serial:"), ("device", "bus:"), ("input", 2**32), ("stride_bytes", 2**32)]
)
def test_what_would_be_cut_off_or_mean_any_camera_is_refused(key, value):
    with pytest.raises(ValidationError, match=key):
        settings(**{key: value})


def test_a_node_that_cannot_be_asked_may_be_the_camera_that_is_looked_for(plugged, context):
    plugged.errors[Request.QUERYCAP] = [errno.EIO]
    with pytest.raises(DeviceFault, match=r"identify camera: .*input/output error \(EIO\)"):
        opened(plugged, context, device="serial:A17")


def test_frames_that_are_all_too_old_are_told_from_none(plugged, context):
    camera = opened(plugged, context, transfer_us=1e7)
    with pytest.raises(DeviceTimeout, match=r"got none but [1-9]\d older; allow more time"):
        camera.grab(2.0)
    camera.close()


@pytest.mark.parametrize("timeout_s", [float("inf"), 1e12])
def test_a_wait_may_be_as_long_as_anyone_likes(timeout_s, tmp_path):
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    node = KernelNode(str(pipe))
    os.write(node._file, b"x")
    assert node.wait(timeout_s)
    node.close()


def test_a_deadline_that_is_no_number_is_over_at_once(camera, clock):
    asked_s = clock.now_s()
    with pytest.raises(DeviceTimeout):
        camera.grab(float("nan"))
    assert clock.now_s() == asked_s


def test_an_exposure_that_nobody_tells_is_no_longer_than_a_frame(plugged, context):
    plugged.controls = {}
    camera = opened(plugged, context, exposure_us=None, gain=None)
    frame = camera.grab(1.0)
    camera.close()
    assert np.isnan(frame.exposure_us)
    assert frame.exposed_s == pytest.approx(plugged.begun_s + (frame.sequence - 1) / 32, abs=2e-6)


def test_a_restart_queues_no_buffer_twice(camera, plugged):
    plugged.errors[Request.QBUF] = [errno.ENOMEM] * 100_000
    camera.grab(1.0)
    plugged.errors = {Request.QBUF: [errno.ENOMEM], Request.DQBUF: [errno.EIO]}
    assert [camera.grab(1.0).flags for _ in range(8)] == [0] * 8
    plugged.pass_time()
    assert len(plugged.queued) + len(plugged.filled) == 4


def test_too_few_buffers_are_refused(plugged, context):
    plugged.most_buffers = 1
    with pytest.raises(DeviceFault, match="get buffers: expected at least 2, got 1; free memory"):
        opened(plugged, context)


def test_a_driver_that_lists_its_controls_in_a_circle_is_asked_once(plugged, context, monkeypatch):
    listed = FakeNode.queryctrl
    first = min(plugged.controls)

    def in_a_circle(node: FakeNode, query) -> None:
        listed(node, query)
        if query.id == max(plugged.controls):
            query.id = first

    monkeypatch.setattr(FakeNode, "queryctrl", in_a_circle)
    opened(plugged, context).close()


def test_a_control_that_is_disabled_is_left_alone(plugged, context):
    plugged.controls[ControlId.FOCUS_AUTO] = FakeControl("Focus", 1, keeps=1, flags=ControlFlag.DISABLED)
    opened(plugged, context).close()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"width": 24}, "expected 32 x 20 px Y12, got 24 x 20 px Y12"),
        ({"field": 4}, r"got 32 x 20 px Y12, interlaced \(field 4\)"),
        (
            {"sizeimage": 1000},
            "rows of at least 64 bytes, 20 of them, got rows of 64 bytes in buffers of 1000",
        ),
        ({"bytesperline": 60}, "expected rows of at least 64 bytes, 20 of them, got rows of 60 bytes"),
    ],
)
def test_a_picture_that_the_rate_has_changed_is_refused(changes, message, plugged, context, monkeypatch):
    answered = FakeNode.g_fmt

    def otherwise(node: FakeNode, format) -> None:
        answered(node, format)
        if plugged.rate_set:
            for name, value in changes.items():
                setattr(format.fmt.pix, name, value)

    plugged.rate_set = False
    monkeypatch.setattr(FakeNode, "g_fmt", otherwise)
    monkeypatch.setattr(FakeNode, "s_parm", lambda *_: setattr(plugged, "rate_set", True))
    with pytest.raises(DeviceFault, match=message):
        opened(plugged, context)


def test_a_camera_without_a_serial_number_is_known_by_its_socket(plugged, context):
    plugged.serial = ""
    camera = opened(plugged, context)
    for bus, same in ((plugged.bus, True), (b"usb-0000:00:14.0-7", False)):
        plugged.present = False
        with pytest.raises(LinkLost, match="unplugged"):
            camera.grab(1.0)
        plugged.present, plugged.bus = True, bus
        if same:
            assert camera.grab(1.0).flags == 0
    with pytest.raises(LinkLost, match=r"expected Mono 12 usb-0000:00:14.0-2, got .*-7"):
        camera.grab(1.0)
    camera.close()


def test_a_last_row_without_its_padding_is_a_whole_picture(plugged, context):
    plugged.padding = 24
    plugged.frame_faults = dict.fromkeys(range(1000), "unpadded")
    camera = opened(plugged, context)
    frame = camera.grab(1.0)
    camera.close()
    assert frame.flags == 0
    assert number_of(frame.image) == plugged.shown - 1


def test_a_stream_is_not_begun_with_settings_that_another_program_changed(camera, plugged):
    plugged.controls[ControlId.GAIN].value = 5
    with pytest.raises(DeviceFault, match="verify gain: expected 4, as it was set, got 5"):
        camera.stream()
    plugged.controls[ControlId.GAIN].value = 4
    assert camera.grab(1.0).flags == 0


def test_a_stream_that_broke_twice_in_one_call_is_restarted_by_the_next(camera, plugged, monkeypatch):
    """The kernel gives no frame of a broken stream until it is stopped and started."""
    plugged.broken, plugged.breaks_again = True, True
    takes, stops, waits = FakeNode.dqbuf, FakeNode.streamoff, FakeNode.wait

    def dqbuf(node: FakeNode, buffer) -> None:
        if plugged.broken:
            raise OSError(errno.EIO, "broken")
        takes(node, buffer)

    def streamoff(node: FakeNode, argument) -> None:
        plugged.broken = False
        stops(node, argument)

    def wait(node: FakeNode, timeout_s: float) -> bool:
        plugged.broken, plugged.breaks_again = plugged.breaks_again, False
        return plugged.broken or waits(node, timeout_s)

    for name, act in (("dqbuf", dqbuf), ("streamoff", streamoff), ("wait", wait)):
        monkeypatch.setattr(FakeNode, name, act)
    with pytest.raises(DeviceFault, match=r"input/output error \(EIO\)"):
        camera.grab(1.0)
    assert camera.grab(1.0).flags == 0


def test_an_exposure_that_something_unknown_holds_is_refused(plugged, context):
    del plugged.controls[ControlId.EXPOSURE_AUTO]
    with pytest.raises(DeviceFault, match="set exposure_time_absolute: expected 100 in effect"):
        opened(plugged, context)


def test_a_further_control_that_an_automatic_holds_is_refused(plugged, context):
    plugged.controls[0x98091A] = FakeControl(
        "White Balance Temperature", 4000, 2800, 6500, flags=ControlFlag.INACTIVE
    )
    with pytest.raises(DeviceFault, match="set white_balance_temperature: expected 5000 in effect"):
        opened(plugged, context, controls={"white_balance_temperature": 5000})


def test_an_exposure_beside_an_automatic_iris_is_in_effect(plugged, context):
    """Some cameras have no fully manual mode; uvcvideo calls the exposure inactive in all modes but that."""
    plugged.controls[ControlId.EXPOSURE_AUTO].keeps = 2
    with pytest.raises(DeviceFault, match="set auto_exposure: expected 1, got 2 on reading back"):
        opened(plugged, context)
    camera = opened(plugged, context, controls={"auto_exposure": 2})
    assert plugged.controls[ControlId.EXPOSURE_ABSOLUTE].flags & ControlFlag.INACTIVE
    assert plugged.controls[ControlId.EXPOSURE_ABSOLUTE].value == 100
    assert camera.grab(1.0).exposure_us == EXPOSURE_US
    camera.close()
