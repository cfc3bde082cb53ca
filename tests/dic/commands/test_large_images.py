"""What `dic correlate` costs on images of 20 and of 100 megapixels, relative to 4 megapixels."""

import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from statistics import median

import cv2
import numpy as np
import pytest

from tests.places import ROOT

TILE_PX, SHIFT_PX = 500, (1.3, -0.7)
SIZES = {1: (1000, 1000), 4: (2000, 2000), 20: (4000, 5000), 100: (10_000, 10_000)}

LARGEST_BYTES_PER_PX = 4.0
"""Four times the image, for 8 bit and a point every 10 px.

The program itself, and the arrays of the bands in work, are in memory for 4 megapixels as well.
"""

PROGRAM = """
import json, os, resource, sys
if sys.argv.pop() == "one processor":
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
from dic.cli import main
try:
    main()
except SystemExit as end:
    status = end.code
with open("/proc/self/status") as lines:
    peak = next(int(line.split()[1]) for line in lines if line.startswith("VmHWM"))
used = resource.getrusage(resource.RUSAGE_SELF)
print(json.dumps({"status": status, "peak": 1024 * peak, "cpu_s": used.ru_utime + used.ru_stime}))
"""


def draw(folder: Path, megapixels: int) -> list[Path]:
    """Draw a pair with 8 bit. A periodic pattern is shifted exactly, by the phase of its waves, and tiled."""
    height, width = SIZES[megapixels]
    rng, along = np.random.default_rng(7), np.fft.fftfreq(TILE_PX)
    waves = np.fft.fft2(rng.normal(size=(TILE_PX, TILE_PX)))
    waves *= np.exp(-2 * (np.pi * 1.4) ** 2 * (along[:, None] ** 2 + along**2))
    phase = np.exp(-2j * np.pi * (along * SHIFT_PX[0] + along[:, None] * SHIFT_PX[1]))
    paths = []
    for name, spectrum in (("reference", waves), ("shifted", waves * phase)):
        tile = np.fft.ifft2(spectrum).real
        tile = 127 + 40 * tile / tile.std()
        image = np.empty((height, width), np.uint8)
        for top in range(0, height, TILE_PX):
            for left in range(0, width, TILE_PX):
                noisy = tile + rng.normal(0, 1.5, tile.shape)
                image[top : top + TILE_PX, left : left + TILE_PX] = np.clip(np.rint(noisy), 0, 255)
        paths.append(folder / f"{name}-{megapixels}.tif")
        assert cv2.imwrite(str(paths[-1]), image, [cv2.IMWRITE_TIFF_COMPRESSION, 1])
    return paths


@pytest.fixture(scope="module")
def cost(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., tuple[float, float]]:
    """Return a function that gives the peak of the memory, bytes, and the processor time, s, of a command.

    With `images=3` the shifted image is measured three times, under three names.
    With `processors=1` the command has one thread, because the processor time of two threads depends on what
    else the computer does.
    """
    folder = tmp_path_factory.mktemp("large")
    drawn: dict[int, list[Path]] = {}

    def measured(megapixels: int, processors: int = 2, images: int = 1) -> tuple[float, float]:
        if megapixels not in drawn:
            drawn[megapixels] = draw(folder, megapixels)
            for number in (2, 3):
                again = folder / f"shifted-{megapixels}-{number}.tif"
                os.link(drawn[megapixels][1], again)
                drawn[megapixels].append(again)
        for place in folder.glob("found.*"):
            # The command would read earlier results.
            place.unlink()
        outputs = ["--json", folder / "found.json", "-o", folder / "found.h5"]
        words = ["correlate", *drawn[megapixels][: images + 1], "--subset", "31", "--step", "10", *outputs]
        words.append("one processor" if processors == 1 else "all processors")
        environment = os.environ | {"PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"}
        command = [sys.executable, "-c", PROGRAM, *map(str, words)]
        done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
        found = json.loads(done.stdout.splitlines()[-1])
        assert found["status"] == 0, done.stderr
        measurements = json.loads((folder / "found.json").read_text())["images"]
        assert len(measurements) == images
        for image in measurements:
            assert image["converged"] == image["points"] > 0.9 * megapixels * 1e4
            assert max(abs(image["raw"][name]) for name in ("exx", "eyy", "exy")) < 1e-6
        return found["peak"], found["cpu_s"]

    return measured


@pytest.mark.long
@pytest.mark.parametrize("images", [1, 3])
def test_memory_grows_as_the_page_says(cost, images):
    fixed = cost(4, images=images)[0]
    for megapixels in (20, 100):
        bytes_per_px = (cost(megapixels, images=images)[0] - fixed) / (1e6 * (megapixels - 4))
        print(f"{megapixels} megapixels: {bytes_per_px:.1f} bytes/px more than 4 megapixels")
        assert bytes_per_px < LARGEST_BYTES_PER_PX


@pytest.mark.long
def test_a_point_takes_the_time_that_it_takes_in_a_small_image(cost):
    """The start of the program is left out: it is the cost of 1 megapixel."""
    # The difference between 4 and 1 megapixel is 0.7 s, and a single time is known to 0.06 s.
    few = [(cost(1, 1)[1], cost(4, 1)[1]) for _ in range(9)]
    start_s, of_4_s = (median(times) for times in zip(*few, strict=True))
    for megapixels in (20, 100):
        found_s = median(cost(megapixels, 1)[1] for _ in range(3))
        ratio = (found_s - start_s) / (megapixels - 1) / ((of_4_s - start_s) / 3)
        print(f"{megapixels} megapixels: {ratio:.2f} of the time of a point at 4 megapixels")
        assert ratio < 1.15
