"""A recorded run file has exactly the names, types, units and attributes that docs/run-file.md lists."""

import re
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

from drivers.interfaces import CameraInfo, DeviceInfo, Frame, InterlockState, LoadFrameState, StageState
from drivers.signals import Signal
from rig.protocol.step import ProtocolStep, RigReading
from rig.recorder import InterlockRecord, Recorder, StepRecord
from rig.recorder.records import ChannelsRecord, SignalRecord
from rig.samples import TimedSamples
from tests.places import DOCS
from tests.run_files import HEADER, START

CAMERAS = {
    "front": CameraInfo("v", "m", "s", width_px=5, height_px=4, bits=12),
    "side": CameraInfo("v", "m", "s", width_px=7, height_px=6, bits=8),
}
DEVICE = DeviceInfo("v", "m", "s")
DOOR = {"door": InterlockRecord("v", "m", "", allowed_min=1.0)}
FORCE = Signal("force", "N", -100.0, 100.0, 0.1, 0.02, 0.5)
BOX = {"box": ChannelsRecord(DEVICE, (SignalRecord(FORCE, "load"),))}
FRAMES, READINGS, STEPS, EVENTS, SETTINGS, SAMPLES = 6, 5, 3, 4, 7, 8
LENGTHS = {"n": FRAMES, "m": READINGS, "k": STEPS, "e": EVENTS, "r": SETTINGS, "c": SAMPLES, "2": 2}


@pytest.fixture
def recorded(tmp_path) -> Path:
    """The file of a run with all kinds of devices, in which each kind of table has a different length."""
    path = tmp_path / "run.h5"
    recorder = Recorder(path, HEADER, CAMERAS, stage=DEVICE, load_frame=DEVICE, interlocks=DOOR, channels=BOX)
    times = [np.arange(float(SAMPLES)) for _ in range(3)]
    recorder.samples("box", TimedSamples(np.ones((SAMPLES, 1)), *times, 7))
    for _ in range(READINGS):
        recorder.stage_state(StageState(1.0, False, True, (), 2.0))
        recorder.load_frame_state(LoadFrameState(1.0, 2.0, False, True, True, 1, (), 3.0))
        recorder.interlock_state("door", InterlockState(1.0, 3.0))
    for index in range(STEPS):
        frames = {}
        for name, camera in CAMERAS.items():
            image = np.zeros((camera.height_px, camera.width_px), np.uint16 if camera.bits > 8 else np.uint8)
            frame = Frame(image, 1.0, 2.0, START, 0, 0, 900.0, 1.0)
            rows = [recorder.frame(name, replace(frame, sequence=i)) for i in range(FRAMES // STEPS)]
            frames[name] = (rows[0], len(rows))
        recorder.step(StepRecord(ProtocolStep(index, "load", 1.0), RigReading(2.0), frames))
    recorder.settings("stage", "start", {f"setting_{number}": "1.0" for number in range(SETTINGS)}, 3.0)
    for _ in range(EVENTS):
        recorder.event(3.0, "info", "engine", "something")
    recorder.close("completed", "", START)
    return path


def documented() -> dict[str, tuple[str, set[str]]]:
    """Return type and attributes of each path, from the page's table, for the cameras of this test."""
    rows = re.findall(r"^\| `(/.*?)` \| (.*?) \| (.*?) ?\| .*\|$", (DOCS / "run-file.md").read_text(), re.M)
    assert len(rows) > 50
    stated = {}
    for path, kind, attributes in rows:
        for camera in CAMERAS:
            named = path.replace("<camera>", camera).replace("<interlock>", "door")
            named = named.replace("<device>", "box").replace("<signal>", "force")
            stated[named] = (kind, set(attributes.replace("`", "").split(", ")))
    return stated


def kind_of(item: h5py.Group | h5py.Dataset, stated: str) -> str:
    """Return the type of an object in the words of the page, for a text with its size only if stated."""
    if isinstance(item, h5py.Group):
        return "group"
    if item.name.endswith("/data"):
        camera = CAMERAS[item.name.split("/")[-2]]
        assert item.dtype == (np.uint16 if camera.bits > 8 else np.uint8)
        assert item.shape == (FRAMES, camera.height_px, camera.width_px)
        assert item.chunks == (1, camera.height_px, camera.width_px)
        assert item.compression is None
        assert not item.fletcher32
        return "uint8 or uint16 (n, height, width)"
    name = item.dtype.name
    if item.dtype.kind == "S":
        assert h5py.check_string_dtype(item.dtype).encoding == "utf-8"
        name = f"text of {item.dtype.itemsize} bytes" if "bytes" in stated else "text"
    letter = re.search(r"\((.)\)$", stated)
    if letter is None:
        assert item.shape == ()
        return name
    assert item.shape == (LENGTHS[letter[1]],)
    assert item.maxshape == ((2,) if letter[1] == "2" else (None,))
    return f"{name} ({letter[1]})"


def attributes_of(item: h5py.Group | h5py.Dataset, stated: set[str]) -> set[str]:
    """Return the attributes of an object, with values only if the page states the values."""
    valued = {part.partition(" = ")[0] for part in stated if " = " in part}
    found = (f"{key} = {value}" if key in valued else key for key, value in item.attrs.items())
    return set(", ".join(found).split(", "))


def test_a_recorded_file_holds_what_the_page_lists_and_nothing_else(recorded):
    stated = documented()
    found = {}

    def look(path: str, item: h5py.Group | h5py.Dataset) -> None:
        kind, attributes = stated.get(path, ("", set()))
        found[path] = (kind_of(item, kind), attributes_of(item, attributes))

    with h5py.File(recorded) as file:
        look("/", file)
        file.visititems(lambda name, item: look(f"/{name}", item))
    assert found == stated
