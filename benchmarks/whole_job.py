"""Which part of `dic correlate` takes how much of its processor time, beside the job of another program?

    python -m benchmarks.whole_job [--images N] [--repetitions N] [--peers] [--json FILE]

Four jobs measure images of 2000 × 2000 px with affine subsets of 31 px and a step of 10 px, each in a program
of its own on one processor (`benchmarks.part_times`): to a result file alone; with a picture of five maps, a
table and JSON for every image; calibrated; and calibrated with the correction of a tensile test. The other
program is the fastest of those that can be installed from the package index. It correlates one pair, and its
time is multiplied by the number of images. It states no standard deviations and draws no maps.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from statistics import median
from typing import Any

import cv2
import numpy as np

from benchmarks import machine, peers
from benchmarks.throughput import draw
from dic.image.read import read_image
from simulators.scene.optics import PinholeCamera
from simulators.scene.render import render
from simulators.scene.scene import Surface
from simulators.scene.texture import LineGrid

SIDE_PX = 2000


def timed(words: list[str], folder: Path) -> dict[str, float]:
    """Return the times of all parts of one job, s, in a program of its own on one processor."""
    one = {f"{library}_NUM_THREADS": "1" for library in ("OMP", "OPENBLAS", "MKL")}
    root = str(Path(__file__).parents[1])
    command = [sys.executable, "-m", "benchmarks.part_times", *words]
    done = subprocess.run(
        command, capture_output=True, text=True, cwd=folder, env={**os.environ, **one, "PYTHONPATH": root}
    )
    if done.returncode:
        raise SystemExit(f"{' '.join(words)}: {(done.stderr.strip().splitlines() or ['no message'])[-1]}")
    times: dict[str, float] = json.loads(done.stdout.splitlines()[-1])
    return {**times, "other": 2 * times["whole"] - sum(times.values())}


def jobs(files: list[Path], calibration: Path) -> dict[str, list[str]]:
    """Return the words of each job."""
    settings = ["--subset", "31", "--step", "10", "--workers", "1", "-o", "results.h5"]
    plain = ["correlate", *map(str, files), *settings]
    outputs = ["--maps", "maps", "--csv", "tables", "--json", "all.json"]
    calibrated = [*plain, "--calibration", str(calibration)]
    return {
        "result file": plain,
        "with maps, tables, JSON": [*plain, *outputs],
        "calibrated": calibrated,
        "with tension corrected": [*calibrated, "--motion", "tension"],
    }


def calibrated_in(folder: Path) -> Path:
    """Write the calibration of a camera that looks at a grid from 30° off-axis, and return its file."""
    camera = PinholeCamera(SIDE_PX, SIDE_PX, focal_px=7000.0, pan_deg=30.0)
    grid = render(camera, Surface(LineGrid()))
    cv2.imwrite(str(folder / "grid.png"), np.clip(255.0 * grid, 0.0, 255.0).astype(np.uint8))
    timed(["calibrate", "grid.png", "-o", "calibration.h5"], folder)
    return folder / "calibration.h5"


def measure(images: int, repetitions: int, with_peers: bool) -> dict[str, Any]:
    """Return the median times of all parts of every job, s, and those of the other program."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        files = draw(folder, images, SIDE_PX)
        every = jobs(files, calibrated_in(folder))
        found: dict[str, list[dict[str, float]]] = {job: [] for job in every}
        theirs: list[float] = []
        for number in range(repetitions + 1):
            for job, words in every.items():
                # In a new folder, because a command takes the images that it finds in its result file.
                with tempfile.TemporaryDirectory(dir=folder) as new:
                    times = timed(words, Path(new))
                if number:  # the first round may compile
                    found[job].append(times)
            if number and with_peers:
                theirs += their_time(files, folder, images)
    medians = {
        job: {part: median(times[part] for times in rounds if part in times) for part in rounds[-1]}
        for job, rounds in found.items()
    }
    return {"machine": machine.describe(), "images": images, "jobs": medians, "peer_s": theirs}


def their_time(files: list[Path], folder: Path, images: int) -> list[float]:
    """Return the time of the other program for all images, s; nothing if it cannot be installed."""
    pair = read_image(files[0]).astype(np.uint8), read_image(files[1]).astype(np.uint8)
    peer = peers.Peer("pyvale", "pyvale==2026.10.*", "run_pyvale.py", 10)
    try:
        return [images * peers.correlate(peer, folder, pair, 31).cpu_s]
    except peers.Unavailable as reason:
        print(f"skipped {peer.label}: {reason}")
        return []


def show(result: dict[str, Any]) -> None:
    """Print the share of each part."""
    on = result["machine"]
    print(f"{on['processor']}, {on['vectors']}; load average {on['load_average']}")
    print(f"processor time of {result['images']} images of {SIDE_PX} × {SIDE_PX} px")
    for job, times in result["jobs"].items():
        whole_s = times["whole"]
        beside = (
            f", pyvale: {median(result['peer_s']) / whole_s:.1f} times as long" if result["peer_s"] else ""
        )
        print(f"\n{job}: {whole_s:.2f} s{beside}")
        for part, time_s in sorted(times.items(), key=lambda each: -each[1]):
            if part != "whole":
                print(f"  {part:14}{time_s:7.2f} s{time_s / whole_s:6.0%}")


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--images", type=int, default=20)
    parser.add_argument("--repetitions", type=int, default=3)
    parser.add_argument("--peers", action="store_true", help="also another program")
    parser.add_argument("--json", type=Path, help="file for the figures")
    given = parser.parse_args()
    result = measure(given.images, given.repetitions, given.peers)
    show(result)
    if given.json is not None:
        given.json.write_text(json.dumps(result, indent=1))


if __name__ == "__main__":
    main()
