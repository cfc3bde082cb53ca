"""Speed of `dic` and of other correlation programs on the same pair of images, in points per second.

    python -m benchmarks.speed [--peers] [--repetitions N] [--json FILE]

The images have 1024 × 1024 px, 8 bit, 2 grey levels of noise and about 1 % of strain. All cases take turns,
and the result is the median over the repetitions. So another load on the computer affects all cases in the
same way. Speeds are points per second of processor time. The gain of two threads is a ratio of elapsed times,
and so it needs an idle computer.
"""

import argparse
import json
import re
import tempfile
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks import machine, peers
from benchmarks.engine import KernelAlone, Series, Timing, time_pair
from benchmarks.speckle import Motion, Speckle, eight_bit, gentle_strain, truth
from dic.correlation.settings import CorrelationSettings
from dic.correlation.status import Status
from dic.typing import Float

SIDE_PX = 1024
STEP_PX = 5
NOISE = 2.0
PEER_SUBSET_PX = 21
_RIM_PX = 75
_LOST_PX = 0.5
"""A point with a larger error counts as lost, and is left out of bias and spread."""

_MOTION = gentle_strain()


@dataclass(frozen=True)
class Pictures:
    """A reference image and two images of a growing deformation; the second of the two is measured."""

    reference: NDArray[np.uint8]
    before: NDArray[np.uint8]
    deformed: NDArray[np.uint8]

    @classmethod
    def draw(cls) -> "Pictures":
        """Draw the three images with the same pattern and different noise."""
        speckle = Speckle(shape=(SIDE_PX, SIDE_PX))
        motions: tuple[Motion | None, ...] = (None, gentle_strain(0.9), _MOTION)
        return cls(*(eight_bit(speckle.draw(m), NOISE, seed) for seed, m in enumerate(motions, 11)))


@dataclass(frozen=True)
class Error:
    """Errors of displacements.

    The bias is the larger mean error of both axes. The spread is the mean of the standard deviations along
    both axes.
    """

    points: int
    lost: int
    bias_mpx: float
    spread_mpx: float


def error_of(points: Float, moved: Float, rim_px: int) -> Error:
    """Compare displacements `moved` (n, 2) at `points` (n, 2) of the reference with the exact displacements.

    Points within `rim_px` of the image's edge are left out, because in some programs their subset or element
    is incomplete.
    """
    inner = ((points > rim_px) & (points < SIDE_PX - rim_px)).all(axis=1)
    points, moved = points[inner], moved[inner]
    exact = np.stack(truth(_MOTION, points[:, 0], points[:, 1]), axis=1)
    error = moved - exact
    good = np.isfinite(error).all(axis=1) & (np.abs(error) < _LOST_PX).all(axis=1)
    bias, spread = np.abs(error[good].mean(axis=0)).max(), error[good].std(axis=0).mean()
    return Error(len(points), int((~good).sum()), 1e3 * float(bias), 1e3 * float(spread))


class Case:
    """One row of the table of `dic`: all measurements with one set of settings."""

    def __init__(self, pictures: Pictures, settings: CorrelationSettings) -> None:
        self.settings = settings
        images = (pictures.reference, pictures.before, pictures.deformed)
        self._reference, before, self._deformed = (image.astype(np.float32) for image in images)
        self._times: dict[str, list[Timing]] = defaultdict(list)
        # These first calls are not timed, because they also compile the kernel.
        self._series = {n: Series(self._reference, before, settings, n) for n in (1, 2)}
        _, field = time_pair(self._reference, self._deformed, settings, 1)
        tried = field.active & (field.status != Status.OUT_OF_VIEW)
        moved = np.stack([field.u_px, field.v_px], axis=-1)[tried]
        x, y = np.meshgrid(field.x_px, field.y_px)
        points = np.stack([x, y], axis=-1)[tried]
        self.error = error_of(points.astype(float), moved, _RIM_PX)
        # Keep a distance from the rim, because the iterations of a subset end when it leaves the image.
        rim = settings.subset_px + 8
        at = np.arange(rim, self._reference.shape[0] - rim, STEP_PX)
        x, y = np.meshgrid(at, at)
        start = np.stack(truth(_MOTION, x.astype(float), y.astype(float)), axis=-1)
        self._kernel = KernelAlone(self._reference, self._deformed, settings, at, at, np.rint(start))
        _, self.iterations = self._kernel.time(1)

    def repeat(self) -> None:
        """Time all three ways once more, with one thread and with two threads."""
        for n in (1, 2):
            self._times[f"kernel {n}"].append(self._kernel.time(n)[0])
            self._times[f"pair {n}"].append(time_pair(self._reference, self._deformed, self.settings, n)[0])
            self._times[f"series {n}"].append(self._series[n].time(self._deformed))

    def summary(self) -> dict[str, Any]:
        """Return the medians and the errors, for the table and for JSON."""
        result: dict[str, Any] = {
            "shape": self.settings.shape, "order": self.settings.order, "subset": self.settings.subset_px,
        }  # fmt: skip
        for way in ("kernel", "pair", "series"):
            one, two = self._times[f"{way} 1"], self._times[f"{way} 2"]
            result[way] = median(t.per_cpu_s for t in one)
            result[f"{way}_2_threads"] = median(t.per_wall_s for t in two)
            gains = [b.per_wall_s / a.per_wall_s for a, b in zip(one, two, strict=True)]
            result[f"{way}_gain"] = median(gains)
        return {**result, "iterations": self.iterations, **vars(self.error)}


def _cases() -> Iterator[CorrelationSettings]:
    for shape, order, subset in product(("affine", "quadratic"), (3, 5), (21, 31)):
        yield CorrelationSettings(subset_px=subset, step_px=STEP_PX, shape=shape, order=order)


class PeerCase:
    """One row of the table of other programs ("peers")."""

    def __init__(self, peer: peers.Peer, pictures: Pictures) -> None:
        self._peer, self._pair = peer, (pictures.reference, pictures.deformed)
        self._speeds: list[float] = []
        self.version = peers.version(peer)

    def repeat(self) -> None:
        """Let the other program correlate the pair once more, in a new temporary folder."""
        with tempfile.TemporaryDirectory() as folder:
            found = peers.correlate(self._peer, Path(folder), self._pair, PEER_SUBSET_PX)
        self._error = error_of(found.points, found.moved, self._peer.margin_px - 32 + _RIM_PX)
        self._speeds.append(len(found.points) / found.cpu_s)

    def summary(self) -> dict[str, Any]:
        """Return the median and the errors, for the table and for JSON."""
        peer = self._peer
        return {
            "engine": f"{peer.label} {self.version}", "shape": peer.shape, "order": peer.order,
            "subset": PEER_SUBSET_PX, "pair": median(self._speeds), **vars(self._error),
        }  # fmt: skip


def _peer_cases(pictures: Pictures) -> Iterator[PeerCase]:
    for peer in peers.PEERS:
        try:
            yield PeerCase(peer, pictures)
        except peers.Unavailable as reason:
            print(f"skipped {peer.label}: {reason}")


def measure(repetitions: int, with_peers: bool) -> dict[str, Any]:
    """Measure all cases, and return the results as a dict that can be written as JSON."""
    before = machine.describe()
    pictures = Pictures.draw()
    cases: list[Case | PeerCase] = [Case(pictures, settings) for settings in _cases()]
    if with_peers:
        cases += _peer_cases(pictures)
    for k in range(repetitions):
        print(f"repetition {k + 1} of {repetitions} …", flush=True)
        for case in cases.copy():
            try:
                case.repeat()
            except peers.Unavailable as reason:
                print(f"skipped a peer: {reason}")
                cases.remove(case)
    ours = [case.summary() for case in cases if isinstance(case, Case)]
    others = [case.summary() for case in cases if isinstance(case, PeerCase)]
    speeds = {(row["shape"], row["order"], row["subset"]): row["pair"] for row in ours}
    for row in others:
        row["ours/theirs"] = speeds[row["shape"], row["order"], row["subset"]] / row["pair"]
    return {
        "machine": before, "load_average_after": machine.describe()["load_average"],
        "repetitions": repetitions, "ours": ours, "peers": others,
    }  # fmt: skip


_OURS = {
    "shape": "{:10}", "order": "{:>6}", "subset": "{:>7}", "kernel": "{:>9.0f}", "pair": "{:>9.0f}",
    "series": "{:>9.0f}", "kernel_gain": "{:>12.2f}", "pair_gain": "{:>10.2f}", "series_gain": "{:>12.2f}",
    "iterations": "{:>11.2f}", "bias_mpx": "{:>9.2f}", "spread_mpx": "{:>11.2f}", "lost": "{:>5}",
}  # fmt: skip
_PEERS = {
    "engine": "{:32}", "shape": "{:10}", "order": "{:>6}", "subset": "{:>7}", "pair": "{:>9.0f}",
    "ours/theirs": "{:>12.1f}", "bias_mpx": "{:>9.2f}", "spread_mpx": "{:>11.2f}", "lost": "{:>5}",
}  # fmt: skip


def _table(columns: dict[str, str], rows: list[dict[str, Any]]) -> None:
    """Print rows below the names of their columns; the format of a column determines its width."""
    heads = (re.sub(r"\.\d+f", "", form).format(name) for name, form in columns.items())
    print("".join(heads))
    for row in rows:
        print("".join(form.format(row[name]) for name, form in columns.items()))


def show(result: dict[str, Any]) -> None:
    """Print the tables."""
    on = result["machine"]
    print(f"\n{on['processor']}, {on['cores']} cores, {on['vectors']}; numba {on['numba']}")
    print(f"load average {on['load_average']} before, {result['load_average_after']} after")
    print("\npoints per second of processor time; gain: speed on the wall, two threads over one")
    _table(_OURS, result["ours"])
    if result["peers"]:
        print("\nother engines: all of a pair, one thread, points per second of processor time")
        _table(_PEERS, result["peers"])


def main() -> None:
    parser = argparse.ArgumentParser(description="Points per second, ours and other engines'.")
    parser.add_argument("--peers", action="store_true", help="install and run other engines too")
    parser.add_argument("--repetitions", type=int, default=5)
    parser.add_argument("--json", type=Path, help="also write what was measured to this file")
    options = parser.parse_args()
    result = measure(options.repetitions, options.peers)
    show(result)
    if options.json:
        options.json.write_text(json.dumps(result, indent=2))


if __name__ == "__main__":
    main()
