"""The V4L2 driver reports cameras that are unplugged, stall or break in time, and uses them again later."""

import errno
import os

import pytest

from drivers.cameras.v4l2.abi import ControlId, RequestCode
from drivers.cameras.v4l2.node import Node
from drivers.errors import DeviceFault, DeviceTimeout, LinkLost
from tests.drivers.cameras.fake_kernel import FakeNode
from tests.drivers.cameras.v4l2.opening import opened


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


def test_a_stalled_camera_is_given_up_at_the_deadline_and_taken_again(camera, plugged, clock):
    plugged.stalled = True
    asked_s = clock.now_s()
    with pytest.raises(DeviceTimeout, match=r"grab: expected a frame exposed after the call, within 0.5 s"):
        camera.grab(0.5)
    assert clock.now_s() - asked_s == pytest.approx(0.5, abs=0.01)
    plugged.stalled = False
    assert camera.grab(1.0).flags == 0


def test_a_deadline_that_is_no_number_is_over_at_once(camera, clock):
    asked_s = clock.now_s()
    with pytest.raises(DeviceTimeout):
        camera.grab(float("nan"))
    assert clock.now_s() == asked_s


@pytest.mark.parametrize("timeout_s", [float("inf"), 1e12])
def test_a_wait_may_be_as_long_as_anyone_likes(timeout_s, tmp_path):
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    node = Node(str(pipe))
    os.write(node._file, b"x")
    assert node.wait(timeout_s)
    node.close()


def test_one_stream_error_is_healed_and_a_lasting_one_reported(camera, plugged):
    camera.grab(1.0)
    plugged.errors[RequestCode.DQBUF] = [errno.EIO]
    first = camera.grab(1.0)
    assert first.flags == 0
    plugged.errors[RequestCode.DQBUF] = [errno.EIO] * 9
    with pytest.raises(DeviceFault, match=r"get frame: expected a frame, got an input/output error \(EIO\)"):
        camera.grab(1.0)
    plugged.errors.clear()
    assert camera.grab(1.0).sequence > first.sequence


def test_a_stream_that_could_not_be_restarted_is_tried_again_at_the_next_call(camera, plugged):
    camera.grab(1.0)
    plugged.errors = {RequestCode.DQBUF: [errno.EIO], RequestCode.STREAMON: [errno.EIO]}
    with pytest.raises(DeviceFault, match=r"input/output error \(EIO\)"):
        camera.grab(1.0)
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


def test_a_buffer_that_the_kernel_refused_is_offered_again(camera, plugged):
    plugged.errors[RequestCode.QBUF] = [errno.EAGAIN, errno.ENOMEM, errno.EINTR]
    for _ in range(6):
        camera.grab(1.0)
    plugged.pass_time()
    assert len(plugged.queued) + len(plugged.filled) == 4


def test_buffers_that_were_all_refused_are_offered_again(camera, plugged):
    def grab_on() -> None:
        while True:
            camera.grab(0.5)

    plugged.errors[RequestCode.QBUF] = [errno.ENOMEM] * 100_000
    with pytest.raises(DeviceTimeout):
        grab_on()
    assert not plugged.queued
    plugged.errors.clear()
    assert camera.grab(1.0).flags == 0


def test_a_restart_queues_no_buffer_twice(camera, plugged):
    plugged.errors[RequestCode.QBUF] = [errno.ENOMEM] * 100_000
    camera.grab(1.0)
    plugged.errors = {RequestCode.QBUF: [errno.ENOMEM], RequestCode.DQBUF: [errno.EIO]}
    assert [camera.grab(1.0).flags for _ in range(8)] == [0] * 8
    plugged.pass_time()
    assert len(plugged.queued) + len(plugged.filled) == 4
