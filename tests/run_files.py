"""Run files for tests: a small good file, and damaged or malicious versions of this file."""

import json
from collections.abc import Callable
from contextlib import closing
from dataclasses import replace
from datetime import UTC, datetime
from hashlib import sha256
from pathlib import Path

import h5py
import numpy as np

from drivers.interfaces import CameraInfo, DeviceInfo, Frame, LoadFrameState
from rig.protocol.grid import Grid
from rig.protocol.step import ProtocolStep, RigReading
from rig.protocol.tables import Sample
from rig.recorder import Recorder, RunHeader, StepRecord

START = datetime(2026, 3, 4, 5, 6, 7, 89000, tzinfo=UTC)
HEADER = RunHeader(
    title="Rotation at 30°",
    run_id="r1",
    definition="",
    configuration="",
    start=START,
    versions="python 3",
    sample=Sample(name="sheet", thickness_mm=1.0, width_mm=25.0, gauge_length_mm=60.0),
    grid=Grid(),
    simulated=True,
)
CAMERAS = {name: CameraInfo("v", "m", "s", width_px=32, height_px=24, bits=8) for name in ("left", "right")}


def take(camera: CameraInfo, number: int) -> Frame:
    """Return a frame whose image depends on the number, so that each number gives a different image."""
    noise = np.random.default_rng(number)
    image = noise.integers(0, 255, (camera.height_px, camera.width_px), np.uint8)
    return Frame(image, float(number), number + 0.1, START, number, 0, 900.0, 1.0)


def write_run(path: Path, loads: int = 4, first: int = 0, header: RunHeader = HEADER) -> Path:
    """Write the file of a completed run with a grid step, a reference step and some load steps.

    The steps before the step `first` are left out.
    """
    recorder = Recorder(path, header, CAMERAS, load_frame=DeviceInfo("v", "m", "s"))
    kinds = ["grid", "reference", *["load"] * loads]
    with closing(_Closing(recorder)):
        for index, kind in list(enumerate(kinds))[first:]:
            recorder.load_frame_state(LoadFrameState(index, 0.1, False, True, True, index, (), float(index)))
            frames = {name: (recorder.frame(name, take(info, index)), 1) for name, info in CAMERAS.items()}
            step = ProtocolStep(index, kind, 1000.0 * index if kind == "load" else np.nan)
            recorder.step(StepRecord(step, RigReading(float(index), 1000.0 * index), frames)).result(20)
            recorder.event(float(index), "info", "engine", "step")
    return path


def write_continued_run(folder: Path) -> Path:
    """Write a run that ended after step 3, and the run with the steps 4 and 5 that continues it."""
    earlier = write_run(folder / "run.h5", loads=2)
    known = {"file": earlier.name, "sha256": sha256(earlier.read_bytes()).hexdigest(), "steps": [0, 1, 2, 3]}
    return write_run(folder / "run-2.h5", first=4, header=replace(HEADER, continues=json.dumps(known)))


class _Closing:
    def __init__(self, recorder: Recorder) -> None:
        self._recorder = recorder

    def close(self) -> None:
        self._recorder.close("completed", "", START)


Change = Callable[[h5py.File], None]

LEFT = "entry/instrument/left"
FRAME = "entry/instrument/load_frame"


def _put(path: str, value: object) -> Change:
    def change(file: h5py.File) -> None:
        file[path][...] = value

    return change


def _replace(path: str, **options: object) -> Change:
    def change(file: h5py.File) -> None:
        del file[path]
        file.create_dataset(path, **options)

    return change


def _link(path: str, link: object) -> Change:
    def change(file: h5py.File) -> None:
        if path in file:
            del file[path]
        file[path] = link

    return change


def _circle(file: h5py.File) -> None:
    file["entry/instrument/left/back"] = file["entry"]


def _two_names(file: h5py.File) -> None:
    file["entry/instrument/third"] = file["entry/instrument/left"]


def _references(file: h5py.File) -> None:
    file.create_dataset("entry/extra", data=[file["entry"].ref], dtype=h5py.ref_dtype)


def _external_storage(file: h5py.File) -> None:
    # The loads would be the bytes of another file of the machine, and could stand in a report.
    del file[f"{FRAME}/load_n"]
    file.create_dataset(f"{FRAME}/load_n", (6,), "f8", external=[("/etc/passwd", 0, 48)])


def _virtual(file: h5py.File) -> None:
    layout = h5py.VirtualLayout((6, 24, 32), np.uint8)
    layout[:] = h5py.VirtualSource("other.h5", "data", shape=(6, 24, 32))
    del file[f"{LEFT}/data"]
    file[LEFT].create_virtual_dataset("data", layout)


def _attribute(file: h5py.File) -> None:
    file.attrs["file_format"] = np.zeros(3)


def _group(file: h5py.File) -> None:
    del file["entry/steps/kind"]
    file.create_group("entry/steps/kind")


def _nested(file: h5py.File) -> None:
    file.create_group("/".join(["entry", *"abcdefghijk"]))


HUGE = 1 << 43
HOSTILE: dict[str, Change] = {
    "a link to itself": _link("entry/instrument/left", h5py.SoftLink("/entry/instrument/left")),
    "a soft link": _link("entry/title", h5py.SoftLink("/entry/run_id")),
    "a link to another file": _link("entry/title", h5py.ExternalLink("/etc/other.h5", "/x")),
    "a circle": _circle,
    "two names": _two_names,
    "nested groups": _nested,
    "an object reference": _references,
    "storage in another file": _external_storage,
    "a view of another file": _virtual,
    "eight tebibytes of images": _replace(f"{LEFT}/data", shape=(HUGE, 1, 1), dtype="u1", chunks=(1, 1, 1)),
    "eight tebibytes of readings": _replace(
        "entry/instrument/load_frame/load_n", shape=(HUGE // 8,), dtype="f8"
    ),
    "one chunk of a gibibyte": _replace(
        f"{LEFT}/data", shape=(6, 1, 1), maxshape=(None, None, None), dtype="u1", chunks=(1, 1 << 15, 1 << 15)
    ),
    "a filter of another library": _replace(f"{LEFT}/data", shape=(6, 24, 32), dtype="u1", compression="lzf"),
    "compound data": _replace("entry/steps/kind", shape=(6,), dtype=np.dtype([("a", "i4")])),
    "numbers for texts": _replace("entry/status", data=3.0),
    "texts for numbers": _replace("entry/steps/load_n", data=[b"abc"] * 6),
    "a text that is no UTF-8": _put("entry/title", b"\xff\xfe\xfd"),
    "an unknown kind of step": _put("entry/steps/kind", b"dance"),
    "settings that are numbers": _replace("entry/settings/value", data=np.zeros(3)),
    "a group for a data set": lambda file: (
        file.__delitem__("entry/steps/kind"),
        file.create_group("entry/steps/kind"),
    ),
    "a data set for a group": _replace("entry/instrument", data=1),
    "no instrument": lambda file: file.__delitem__("entry/instrument"),
    "no camera": lambda file: [file.__delitem__(f"entry/instrument/{name}") for name in CAMERAS],
    "a camera named like a path": lambda file: file.move(LEFT, "entry/instrument/..\\left"),
    "colour images": _replace(f"{LEFT}/data", shape=(6, 24, 32, 3), dtype="u1"),
    "images of no size": _replace(f"{LEFT}/data", shape=(6, 0, 32), dtype="u1"),
    "fewer images than rows": _replace(f"{LEFT}/data", shape=(2, 24, 32), dtype="u1"),
    "a column that is too short": _replace("entry/steps/target", data=np.zeros(2)),
    "billions of images in a step": _put("entry/steps/count_left", 1 << 62),
    "negative rows": _put("entry/steps/frames_left", -1),
    "a grid of billions of lines": _put("entry/grid/lines", 1 << 40),
    "a grid without lines": _put("entry/grid/lines", 0),
    "a pitch that is no number": _put("entry/grid/pitch_mm", np.nan),
    "a pitch of zero": _put("entry/grid/pitch_mm", 0.0),
    "an infinite plate": _put("entry/mounting/plate_mm", np.inf),
    "half a hinge": _put("entry/mounting/tilt_axis_mm", [np.nan, 1.0]),
    "a negative shift": _put("entry/mounting/shift_std_um", -1.0),
    "a format that is no text": _attribute,
    "no attribute": lambda file: file["entry"].attrs.clear(),
}
"""Malicious or damaging changes of a run file, which a reader must refuse."""


def changed(good: Path, change: Change, path: Path) -> Path:
    """Write a copy of a run file with a change."""
    path.write_bytes(good.read_bytes())
    with h5py.File(path, "r+") as file:
        change(file)
    return path
