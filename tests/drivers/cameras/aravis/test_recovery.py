"""An Aravis camera that sends no frames is reopened on a separate thread, and calls keep their deadlines."""

import math
import threading

import pytest

from drivers.cameras.aravis.camera import AravisCamera
from drivers.errors import DeviceFault, DeviceTimeout, LinkLost
from tests.drivers.cameras.aravis.opening import DEADLINE_S, opened
from tests.drivers.cameras.fake_aravis import INTERVAL_S, FakeLibrary


def given_up_and_slow_to_open(library: FakeLibrary, camera: AravisCamera) -> threading.Event:
    """Make a camera stop sending frames, so that it is reopened; reopening lasts until the event is set."""
    library.silent = True
    with pytest.raises(DeviceTimeout, match="got none"):
        camera.grab(0.5)
    answer, opens = threading.Event(), library.camera_new
    library.camera_new = lambda name: answer.wait(DEADLINE_S) and opens(name)
    return answer


def test_a_silent_camera_is_opened_anew_and_another_one_in_its_place_refused(library, context):
    camera = opened(library, context)
    library.silent = True
    with pytest.raises(DeviceTimeout, match=r"grab: .* within 0\.5 s, got none; check cable"):
        camera.grab(0.5)
    library.gone = True
    with pytest.raises(LinkLost, match="expected the camera with serial number G1, got Device not found"):
        camera.grab(DEADLINE_S)
    library.gone = library.silent = False
    library.serial = "G2"
    with pytest.raises(LinkLost, match="got the camera with serial number G2"):
        camera.grab(DEADLINE_S)
    library.serial, library.taken = "G1", -1
    assert camera.grab(DEADLINE_S).flags == 0
    camera.close()
    assert library.held == 0
    assert not any(thread.name.startswith("close") for thread in threading.enumerate())


def test_a_camera_that_stops_answering_is_lost_and_found_again(library, context):
    camera = opened(library, context)
    camera.grab(1.0)
    library.gone = True
    with pytest.raises(LinkLost, match="verify frame_rate: expected 32, got Device not found; check"):
        camera.grab(1.0)
    library.gone, library.taken = False, -1
    assert camera.grab(DEADLINE_S).flags == 0
    camera.close()
    assert library.held == 0


def test_calls_keep_their_deadlines_while_a_camera_is_opened_again(library, context):
    camera = opened(library, context)
    answer = given_up_and_slow_to_open(library, camera)
    library.silent, library.taken = False, -1
    for _ in range(2):
        with pytest.raises(DeviceTimeout, match="got a connection that is still being given up or made"):
            camera.grab(0.01)
    answer.set()
    assert camera.grab(DEADLINE_S).flags == 0
    camera.close()
    assert library.held == 0


def test_a_camera_that_is_closed_while_it_is_opened_again_is_let_go(library, context):
    camera = opened(library, context)
    answer = given_up_and_slow_to_open(library, camera)
    with pytest.raises(DeviceTimeout, match="still being given up or made"):
        camera.grab(0.01)
    answer.set()
    camera.close()
    assert library.held == 0


def test_a_call_does_not_wait_for_another_beyond_its_deadline(library, context, clock):
    camera = opened(library, context)
    asked, going, pops = threading.Event(), threading.Event(), library.stream_timeout_pop_buffer

    def slowly(stream: int, timeout_us: int) -> int:
        asked.set()
        going.wait(DEADLINE_S)
        return pops(stream, timeout_us)

    library.stream_timeout_pop_buffer = slowly
    other = threading.Thread(target=camera.grab, args=(1.0,))
    other.start()
    asked.wait(DEADLINE_S)
    with pytest.raises(DeviceTimeout, match="a camera that no other call uses, got one in use"):
        camera.grab(0.01)
    closing = threading.Thread(target=camera.close)
    closing.start()
    going.set()
    other.join()
    closing.join()
    with pytest.raises(DeviceFault, match="got a closed one"):
        camera.grab(1.0)
    assert library.held == 0


def test_a_camera_is_not_given_up_for_a_call_without_a_deadline_that_can_be_kept(library, context):
    camera = opened(library, context)
    opens = []
    library.camera_new = opens.append
    for timeout_s in (0.0, -1.0, math.nan, INTERVAL_S / 4):
        with pytest.raises(DeviceTimeout, match="got none"):
            camera.grab(timeout_s)
    assert camera.grab(1.0).flags == 0
    library.silent = True
    with pytest.raises(DeviceTimeout, match="got none"):
        camera.grab(2 * INTERVAL_S)
    assert library.held == 2
    with pytest.raises(DeviceTimeout, match="got none"):
        camera.grab(2 * INTERVAL_S)
    camera.close()
    assert (library.held, opens) == (0, [])


def test_only_silence_that_lasts_is_a_reason_to_open_a_camera_anew(library, context):
    interval_s = 2.0  # a camera is opened again aside, within the call's deadline by the machine's clock
    camera = opened(library, context, rate_hz=1 / interval_s, transfer_us=0.0)
    first = camera._session

    def is_silent(timeout_s: float) -> None:
        with pytest.raises(DeviceTimeout, match="got none;"):
            camera.grab(timeout_s)

    for _ in range(3):
        library.silent = True
        is_silent(2 * interval_s)
        library.silent = False
        assert camera.grab(1.0).flags == 0
    assert camera._session is first
    library.silent = True
    is_silent(4 * interval_s)
    assert camera._session is None
    is_silent(2 * interval_s)
    assert camera._session is not None
    camera.close()


def test_a_camera_whose_frames_are_all_too_old_is_not_opened_anew(library, context):
    camera = opened(library, context, transfer_us=1e7)
    first = camera._session
    for _ in range(3):
        with pytest.raises(DeviceTimeout, match=r"got none but \d+ older; allow more time"):
            camera.grab(0.5)
    assert camera._session is first
    camera.close()
