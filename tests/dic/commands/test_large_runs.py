"""How much memory `dic process` needs for a run of 20 megapixels, relative to 4 megapixels."""

import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dic.image.read import read_image
from drivers.interfaces import CameraInfo, DeviceInfo, Frame
from rig.protocol.grid import Grid
from rig.protocol.step import ProtocolStep, RigReading
from rig.recorder import Recorder, StepRecord
from tests.dic.commands.test_large_images import PROGRAM, SIZES, draw
from tests.places import ROOT
from tests.run_files import HEADER, START

LOADS = 3
LARGEST_BYTES_PER_PX = 30.0
"""A point of a run needs more memory than a point of a pair; docs/correlation.md has the figure."""


def draw_grid(shape: tuple[int, int]) -> tuple[Grid, np.ndarray]:
    """Draw a grid of dark lines that covers an image of `shape`, with edges about 2 px wide."""
    pitch_px = min(shape) / 21.6
    counts, inks = [int(length / pitch_px) for length in shape], []
    for length, lines in zip(shape, counts, strict=True):
        first_px = (length - (lines - 1) * pitch_px) / 2
        from_first_px = np.arange(length) - first_px
        nearest = np.clip(np.rint(from_first_px / pitch_px), 0, lines - 1)
        off_px = np.abs(from_first_px - nearest * pitch_px)
        inks.append(0.5 - 0.5 * np.tanh((off_px - 0.06 * pitch_px) / 1.4))
    image = np.rint(220 - 170 * np.maximum.outer(*inks)).astype(np.uint8)
    return Grid(lines_y=counts[0], lines_x=counts[1]), image


def write_run(folder: Path, megapixels: int) -> Path:
    """Write a run of one camera: the grid, the reference, and the shifted image several times."""
    height, width = SIZES[megapixels]
    reference, shifted = (read_image(path).astype(np.uint8) for path in draw(folder, megapixels))
    camera = CameraInfo("v", "m", "s", width_px=width, height_px=height, bits=8)
    path = folder / f"run-{megapixels}.h5"
    grid, image_of_grid = draw_grid((height, width))
    recorder = Recorder(
        path, replace(HEADER, grid=grid), {"aside": camera}, load_frame=DeviceInfo("v", "m", "s")
    )
    for n, image in enumerate([image_of_grid, reference, *[shifted] * LOADS]):
        kind = ("grid", "reference")[n] if n < 2 else "load"
        step = ProtocolStep(n, kind, 1000.0 if kind == "load" else np.nan)
        frame = recorder.frame("aside", Frame(image, float(n), n + 0.1, START, n, 0, 900.0, 1.0))
        recorder.step(StepRecord(step, RigReading(float(n), 1000.0), {"aside": (frame, 1)})).result(60)
    recorder.close("completed", "", START)
    return path


def peak_bytes(run: Path) -> int:
    """Process a run in a program of its own, check its strains, and return the peak of its memory."""
    for old in run.parent.glob("found.*"):
        old.unlink()
    outputs = ["-o", run.parent / "found.h5", "--json", run.parent / "found.json"]
    words = ["process", run, "--subset", "31", "--step", "10", *outputs, "all processors"]
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, *map(str, words)],
        env=os.environ | {"PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
        check=True,
    )
    found = json.loads(done.stdout.splitlines()[-1])
    assert found["status"] == 0, done.stdout + done.stderr
    steps = json.loads((run.parent / "found.json").read_text())["cameras"]["aside"]["steps"]
    assert len(steps) == LOADS
    for step in steps:
        assert step["converged"] == step["points"]
        assert max(abs(step["raw"][name]) for name in ("exx", "eyy", "exy")) < 1e-6
    return int(found["peak"])


@pytest.mark.long
def test_memory_of_a_run_grows_as_the_page_says(tmp_path):
    small, large = (peak_bytes(write_run(tmp_path, megapixels)) for megapixels in (4, 20))
    bytes_per_px = (large - small) / 16e6
    print(f"{small / 1e6:.0f} MB, {large / 1e6:.0f} MB: {bytes_per_px:.1f} bytes/px more than 4 megapixels")
    assert bytes_per_px < LARGEST_BYTES_PER_PX
