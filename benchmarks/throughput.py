"""How much of the time of `dic correlate` is correlation, and what do more processes gain?

    python -m benchmarks.throughput [--images N] [--side-px N] [--json FILE]

The command reads image files and writes a result file, with subsets of 31 px and a step of 10 px. It is timed
with one processor, with its threads, and with two processes. In turns with these, the correlation alone is
timed: the same images in memory, on one processor, without strains and files. All times are per image: the
time of a long series minus that of a short one, so that neither the start nor the reference counts. Processor
times are those of all processes together. The times on the wall are valid only on an idle computer.
"""

import argparse
import json
import resource
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from pathlib import Path
from statistics import median
from typing import Any

import cv2

from benchmarks import machine
from benchmarks.speckle import Speckle, eight_bit, shift
from dic.correlation.series import Series
from dic.correlation.settings import CorrelationSettings
from dic.image.read import read_image
from dic.image.threads import limited_to

SHORT = 4
NOISE = 2.0
SETTINGS = CorrelationSettings(subset_px=31, step_px=10)
WAYS = {"one processor": ["--workers", "1"], "threads": [], "two processes": ["--workers", "2"]}
_BEGIN = "import sys; from dic.cli import main; sys.argv[0] = 'dic'; main()"


def draw(folder: Path, images: int, side_px: int) -> list[Path]:
    """Draw a reference and images, each with its own noise, that move to and fro by parts of a pixel."""
    speckle = Speckle(shape=(side_px, side_px))
    places = [speckle.draw(shift(0.3 * number, 0.1 * number)) for number in range(4)]
    files = [folder / f"img{number:03d}.tif" for number in range(images + 1)]
    for number, file in enumerate(files):
        picture = eight_bit(places[number % len(places)], NOISE, number)
        cv2.imwrite(str(file), picture, [cv2.IMWRITE_TIFF_COMPRESSION, 1])
    return files


def time_command(files: list[Path], options: list[str], result: Path) -> dict[str, float]:
    """Return the times of `dic correlate` as a program of its own, s."""
    words = ["correlate", *map(str, files), "--subset", "31", "--step", "10", *options, "-o", str(result)]
    before, begin = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    subprocess.run([sys.executable, "-c", _BEGIN, *words], check=True, capture_output=True)
    after, wall_s = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter() - begin
    result.unlink()
    cpu_s = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return {"cpu_s": cpu_s, "wall_s": wall_s}


def time_alone(files: list[Path]) -> dict[str, float]:
    """Return the times of the correlation alone on one processor, s."""
    pictures = [read_image(file) for file in files]
    with limited_to(1), machine.Stopwatch() as watch:
        series = Series(pictures[0], settings=SETTINGS)
        for picture in pictures[1:]:
            series.correlate(picture)
    return {"cpu_s": watch.cpu_s, "wall_s": watch.wall_s}


def measure_times(images: int, side_px: int, repetitions: int) -> dict[str, dict[str, float]]:
    """Return the times per image of every way, s: medians of the repetitions."""
    found: dict[str, dict[str, list[float]]] = defaultdict(lambda: defaultdict(list))
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        files = draw(folder, images, side_px)
        time_command(files[: SHORT + 1], [], folder / "r.h5")
        for _ in range(repetitions):
            for way in ("alone", *WAYS):
                short, whole = (
                    time_alone(some) if way == "alone" else time_command(some, WAYS[way], folder / "r.h5")
                    for some in (files[: SHORT + 1], files)
                )
                for kind in short:
                    found[way][kind].append((whole[kind] - short[kind]) / (images - SHORT))
    return {
        way: {kind: float(median(times)) for kind, times in kinds.items()} for way, kinds in found.items()
    }


def ratios(times: dict[str, dict[str, float]]) -> dict[str, float]:
    """Return the ratios that the documentation states."""
    one, two = times["one processor"], times["two processes"]
    return {
        "share of correlation, processor time": times["alone"]["cpu_s"] / one["cpu_s"],
        "two processes against one, if all processors are busy": 2 * one["cpu_s"] / two["cpu_s"],
        "two processes against one, on the wall": one["wall_s"] / two["wall_s"],
        "threads against one processor, on the wall": one["wall_s"] / times["threads"]["wall_s"],
    }


def main() -> None:
    """Measure and print the times."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--images", type=int, default=16)
    parser.add_argument("--side-px", type=int, default=2000)
    parser.add_argument("--repetitions", type=int, default=3)
    parser.add_argument("--json", type=Path, help="file for the figures")
    given = parser.parse_args()
    times = measure_times(given.images, given.side_px, given.repetitions)
    result: dict[str, Any] = {"machine": machine.describe(), "times": times, "ratios": ratios(times)}
    for way, kinds in times.items():
        print(f"{way:16} " + ", ".join(f"{kind} {1e3 * time_s:.0f} ms" for kind, time_s in kinds.items()))
    for name, ratio in result["ratios"].items():
        print(f"{name}: {ratio:.2f}")
    if given.json is not None:
        given.json.write_text(json.dumps(result, indent=1))


if __name__ == "__main__":
    main()
