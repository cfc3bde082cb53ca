"""How much of the time of `dic correlate` is correlation, and what do more processes gain?

    python -m benchmarks.throughput [--images N] [--side-px N] [--dask] [--json FILE]

The command reads image files and writes a result file, with subsets of 31 px and a step of 10 px. It is timed
with one processor, with its threads, and with two processes; with --dask also on two Dask workers of this
computer. Two separate programs with one processor each, which measure the same images at the same time, show
what this computer gains from a second processor. In turns with these, the correlation alone is timed: the
same images in memory, on one processor, without strains and files. All times are per image: the time of a
long series minus that of a short one, so that neither the start nor the reference counts. Processor times
are those of all processes together, Dask's included. Each ratio is the median over the repetitions, because
a shared computer may change its speed between them. The times on the wall are valid only on an idle computer.
"""

import argparse
import json
import os
import resource
import shlex
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
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
_START_S = 30.0
NOISE = 2.0
SETTINGS = CorrelationSettings(subset_px=31, step_px=10)
DASK = "two Dask workers"
Times = dict[str, dict[str, float]]
"""The times per image of every way, s, of one repetition."""

_ROOT = Path(__file__).parents[1]
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


class Cluster:
    """A Dask scheduler and two workers on this computer.

    Attributes
    ----------
    address : str
        Address of the scheduler.
    """

    def __init__(self, folder: Path) -> None:
        self._programs: list[subprocess.Popen[str]] = []
        log = folder / "scheduler.log"
        self._start(log, "scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard")
        self.address = self._address_in(log)
        words = ("--nworkers", "2", "--nthreads", "1", "--no-dashboard")
        self._start(folder / "workers.log", "worker", self.address, *words)

    def _start(self, log: Path, program: str, *words: str) -> None:
        command = [sys.executable, "-m", f"distributed.cli.dask_{program}", *words]
        found = os.environ | {"PYTHONPATH": os.pathsep.join([str(_ROOT), *filter(None, sys.path)])}
        with log.open("w") as lines:
            self._programs.append(
                subprocess.Popen(command, stdout=lines, stderr=lines, text=True, cwd=log.parent, env=found)
            )

    def _address_in(self, log: Path) -> str:
        """Wait for the scheduler's line that contains its address."""
        deadline_s = time.monotonic() + _START_S
        while time.monotonic() < deadline_s and self._programs[0].poll() is None:
            lines = log.read_text().splitlines(keepends=True)
            for line in lines:
                if "Scheduler at:" in line and "tcp://" in line and line.endswith("\n"):
                    return line.split()[-1]
            time.sleep(0.1)
        self.close()
        last = (log.read_text().splitlines() or ["nothing"])[-1]
        raise SystemExit(f"no Dask scheduler: {last}; install Dask with pip install 'offaxis[cluster]'")

    def cpu_s(self) -> float:
        """Return the processor time that the scheduler and the workers have used so far, s."""
        programs = [each.pid for each in self._programs]
        # Each worker is a child of the program that starts it.
        for program in programs:
            for thread in Path(f"/proc/{program}/task").iterdir():
                programs += map(int, (thread / "children").read_text().split())
        used = [Path(f"/proc/{each}/stat").read_text().rsplit(")", 1)[1].split()[11:13] for each in programs]
        return sum(int(ticks) for pair in used for ticks in pair) / os.sysconf("SC_CLK_TCK")

    def close(self) -> None:
        """End the workers, then the scheduler."""
        for program in reversed(self._programs):
            program.terminate()
            program.wait()


@dataclass(frozen=True)
class Way:
    """A way to measure images: the options of the command, the number of programs, and their cluster."""

    options: Sequence[str]
    programs: int = 1
    cluster: Cluster | None = None


WAYS = {
    "threads": Way([]),
    "two programs": Way(["--workers", "1"], programs=2),
    "one processor": Way(["--workers", "1"]),
    "two processes": Way(["--workers", "2"]),
}


@contextmanager
def ways_of(folder: Path, dask: bool) -> Iterator[dict[str, Way]]:
    """Provide all ways to measure; the last one may have a cluster, which is closed at the end."""
    cluster = Cluster(folder) if dask else None
    try:
        last = {} if cluster is None else {DASK: Way(["--scheduler", cluster.address], cluster=cluster)}
        yield WAYS | last
    finally:
        if cluster is not None:
            cluster.close()


def time_command(files: list[Path], way: Way, folder: Path) -> dict[str, float]:
    """Return the times of `dic correlate` in programs of their own, s, divided by the number of programs."""
    words = ["correlate", *map(str, files), "--subset", "31", "--step", "10", *way.options, "-o"]
    others_s = 0.0 if way.cluster is None else way.cluster.cpu_s()
    results = [folder / f"r{number}.h5" for number in range(way.programs)]
    before, begin = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    commands = [[sys.executable, "-c", _BEGIN, *words, str(result)] for result in results]
    running = [
        subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
        for command in commands
    ]
    try:
        said = [program.communicate()[1] for program in running]
    finally:
        for program in running:
            program.kill()
    after, wall_s = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter() - begin
    for program, words_of_error in zip(running, said, strict=True):
        if program.returncode:
            command = shlex.join(map(str, program.args))
            raise SystemExit(f"{command}: ended with status {program.returncode}: {words_of_error}")
    others_s = 0.0 if way.cluster is None else way.cluster.cpu_s() - others_s
    for result in results:
        result.unlink()
    cpu_s = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime + others_s
    return {"cpu_s": cpu_s / way.programs, "wall_s": wall_s / way.programs}


def time_alone(files: list[Path]) -> dict[str, float]:
    """Return the times of the correlation alone on one processor, s."""
    pictures = [read_image(file) for file in files]
    with limited_to(1), machine.Stopwatch() as watch:
        series = Series(pictures[0], settings=SETTINGS)
        for picture in pictures[1:]:
            series.correlate(picture)
    return {"cpu_s": watch.cpu_s, "wall_s": watch.wall_s}


def measure_times(images: int, side_px: int, repetitions: int, *, dask: bool = False) -> list[Times]:
    """Return the times per image of every way, s, for each repetition."""
    found: list[Times] = []
    with tempfile.TemporaryDirectory() as name, ways_of(Path(name), dask) as ways:
        files = draw(Path(name), images, side_px)
        for each in ways.values():
            time_command(files[: SHORT + 1], each, Path(name))
        for _ in range(repetitions):
            found.append({})
            for way in ("alone", *ways):
                short, whole = (
                    time_alone(some) if way == "alone" else time_command(some, ways[way], Path(name))
                    for some in (files[: SHORT + 1], files)
                )
                found[-1][way] = {kind: (whole[kind] - short[kind]) / (images - SHORT) for kind in short}
    return found


def ratios(times: Times) -> dict[str, float]:
    """Return the ratios that the documentation states, of one repetition."""
    one, two = times["one processor"], times["two processes"]
    found = {
        "share of correlation, processor time": times["alone"]["cpu_s"] / one["cpu_s"],
        "two processes against one, if all processors are busy": 2 * one["cpu_s"] / two["cpu_s"],
        "two processes against one, on the wall": one["wall_s"] / two["wall_s"],
        "two programs against one, on the wall": one["wall_s"] / times["two programs"]["wall_s"],
        "threads against one processor, on the wall": one["wall_s"] / times["threads"]["wall_s"],
    }
    if DASK in times:
        found["two Dask workers against two processes, on the wall"] = two["wall_s"] / times[DASK]["wall_s"]
        found["two Dask workers against two processes, processor time"] = two["cpu_s"] / times[DASK]["cpu_s"]
    return found


def medians(found: list[dict[str, float]]) -> dict[str, float]:
    """Return the median of each value over the repetitions."""
    return {name: float(median(each[name] for each in found)) for name in found[0]}


def main() -> None:
    """Measure and print the times."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--images", type=int, default=36)
    parser.add_argument("--side-px", type=int, default=2000)
    parser.add_argument("--repetitions", type=int, default=3)
    parser.add_argument("--dask", action="store_true", help="also two Dask workers; Linux only")
    parser.add_argument("--json", type=Path, help="file for the figures")
    given = parser.parse_args()
    times = measure_times(given.images, given.side_px, given.repetitions, dask=given.dask)
    of_each = [ratios(each) for each in times]
    result: dict[str, Any] = {
        "machine": machine.describe(),
        "times": {way: medians([each[way] for each in times]) for way in times[0]},
        "ratios": medians(of_each),
        "repetitions": times,
    }
    for way, kinds in result["times"].items():
        print(f"{way:16} " + ", ".join(f"{kind} {1e3 * time_s:.0f} ms" for kind, time_s in kinds.items()))
    for name, ratio in result["ratios"].items():
        print(f"{name}: {ratio:.2f} (" + ", ".join(f"{each[name]:.2f}" for each in of_each) + ")")
    if given.json is not None:
        given.json.write_text(json.dumps(result, indent=1))


if __name__ == "__main__":
    main()
