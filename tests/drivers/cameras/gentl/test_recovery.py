"""A GenTL camera that is gone is told, opened again on a separate thread, and not mistaken for another."""

from dataclasses import replace

import pytest

from drivers.errors import DeviceFault, DeviceTimeout, LinkLost
from tests.drivers.cameras.fake_gentl import FakeDevice, FakeProducer, opened

DEADLINE_S = 60.0


def test_an_unplugged_camera_is_told_and_opened_again(plugged, context):
    producer = FakeProducer(plugged)
    camera = opened(producer, context)
    camera.grab(1.0)
    plugged.gone = True
    with pytest.raises(LinkLost, match="get frame: expected a frame, got Device has been removed"):
        camera.grab(1.0)
    with pytest.raises(LinkLost, match="expected the camera 'Maker-S1', got no camera at all"):
        camera.grab(DEADLINE_S)
    plugged.gone = False
    assert camera.grab(DEADLINE_S).flags == 0
    camera.close()
    assert (plugged.connections, producer.users) == (0, 0)


def test_another_camera_of_the_same_name_does_not_take_its_place(plugged, context, clock):
    other = FakeDevice(clock)
    other.listed = replace(plugged.listed, serial="S2", id="Maker-S2")
    producer = FakeProducer(plugged)
    camera = opened(producer, context, camera="left camera")
    plugged.gone = True
    producer.plugged.append(other)
    with pytest.raises(LinkLost, match="Device has been removed"):
        camera.grab(1.0)
    with pytest.raises(LinkLost, match="expected the camera 'Maker-S1', got only Gen S2"):
        camera.grab(DEADLINE_S)
    assert other.connections == 0
    camera.close()


def test_a_silent_camera_is_opened_anew(plugged, context):
    camera = opened(plugged, context)
    first = camera._session
    plugged.silent = True
    with pytest.raises(DeviceTimeout, match=r"within 0\.5 s, got none"):
        camera.grab(0.5)
    plugged.silent = False
    assert camera.grab(DEADLINE_S).flags == 0
    assert camera._session is not first
    camera.close()
    assert plugged.connections == 0


@pytest.mark.parametrize("name", ["S1", "Maker-S1", "left camera", "Gen"])
def test_a_camera_is_chosen_by_any_of_its_names(name, plugged, context):
    camera = opened(plugged, context, camera=name)
    assert (camera.info.vendor, camera.info.model, camera.info.serial) == ("Maker", "Gen", "S1")
    assert not camera.info.simulated
    camera.close()


def test_a_name_of_several_cameras_is_refused(plugged, context, clock):
    other = FakeDevice(clock)
    other.listed = replace(plugged.listed, serial="S2", id="Maker-S2", name="")
    with pytest.raises(DeviceFault, match=r"expected one camera of this name, got 2, .* S1, S2; give the"):
        opened(FakeProducer(plugged, other), context, camera="Gen")


def test_a_camera_in_other_hands_is_told(plugged, context):
    first = opened(plugged, context)
    with pytest.raises(LinkLost, match=r"open camera: expected a free camera, got .* already in use"):
        opened(plugged, context)
    first.close()
    assert plugged.connections == 0
