"""Fixtures for tests of several packages, such as real images, and drawn speckle images with known motion."""

import os
import signal
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from drivers.clock import VirtualClock
from tests.places import SHARED_DATA

for _number, _usual in (
    (signal.SIGINT, signal.default_int_handler),
    (signal.SIGHUP, signal.SIG_DFL),
    (signal.SIGQUIT, signal.SIG_DFL),
):
    # under nohup, and in a shell's background, they are ignored, and so by every program that a test starts
    if signal.getsignal(_number) is signal.SIG_IGN:
        signal.signal(_number, _usual)

pytest_plugins = ("tests.limits", "tests.realtime")


@pytest.fixture(scope="session", autouse=True)
def _disk_without_delay() -> Iterator[None]:
    """Replace `os.fsync` by a check of its argument, because a disk needs milliseconds to synchronise a file.

    No test simulates a power cut. The tests that count the recorder's calls of `os.fsync` replace `os.fsync`
    once more.
    """
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(os, "fsync", lambda descriptor: os.fstat(descriptor) and None)
        yield


Warp = Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]


@pytest.fixture(scope="session")
def real_images() -> Path:
    """The folder with images of other laboratories; a test is skipped if the folder does not exist."""
    folder = SHARED_DATA
    if not folder.is_dir():
        pytest.skip("the real image series are not on this machine (expected in ../shared/data)")
    return folder


@pytest.fixture
def clock() -> VirtualClock:
    """A clock with simulated time, so that no test waits in real time."""
    return VirtualClock()


@pytest.fixture
def serve() -> Iterator[Callable[[Any], Any]]:
    """A function `serve(server)` that returns the server; the server is closed at the end of the test."""
    with ExitStack() as servers:
        yield lambda server: servers.enter_context(closing(server))


def unmoved(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return x, y


@dataclass(frozen=True)
class SpecklePattern:
    """A pattern of Gaussian dots, of which an image after any motion can be drawn without interpolation.

    `draw(back)` returns the image after a motion. The function `back(x, y)` returns the place in the
    reference that is seen at (x, y).
    """

    seed: int = 1
    shape: tuple[int, int] = (160, 180)
    density: float = 0.02
    margin: int = 40
    noise: float = 0.0
    dots: np.ndarray = field(init=False)

    def __post_init__(self) -> None:
        rng = np.random.default_rng(self.seed)
        height, width = self.shape
        n = int(self.density * (height + 2 * self.margin) * (width + 2 * self.margin))
        low, high = (
            [-self.margin, -self.margin, 1.4, 0.5],
            [width + self.margin, height + self.margin, 2.4, 1.0],
        )
        object.__setattr__(self, "dots", rng.uniform(low, high, (n, 4)))

    def draw(self, back: Warp = unmoved, noise_seed: int = 0) -> np.ndarray:
        rows, columns = np.mgrid[: self.shape[0], : self.shape[1]].astype(float)
        x, y = back(columns, rows)
        sum_of_dots = np.zeros(x.size)
        order = np.argsort(x.ravel())
        xs, ys = x.ravel()[order], y.ravel()[order]
        for cx, cy, sigma, weight in self.dots:
            first, last = np.searchsorted(xs, (cx - 5 * sigma, cx + 5 * sigma))
            near = first + np.flatnonzero(np.abs(ys[first:last] - cy) < 5 * sigma)
            squared = (xs[near] - cx) ** 2 + (ys[near] - cy) ** 2
            sum_of_dots[order[near]] += weight * np.exp(-squared / (2 * sigma**2))
        grey = (225 - 200 * (1 - np.exp(-1.1 * sum_of_dots))).reshape(self.shape)
        grey += np.random.default_rng(noise_seed).normal(0, 1, self.shape) * self.noise
        return grey.astype(np.float32)


@pytest.fixture(scope="session")
def speckle() -> type[SpecklePattern]:
    """The class `SpecklePattern`, whose arguments are `seed`, `shape`, `noise` and others."""
    return SpecklePattern


def turned(angle_deg: float, centre: tuple[float, float], scale: float = 1.0) -> Warp:
    """Return the function `back` of an image turned anticlockwise and enlarged about `centre`."""
    c, s = np.cos(np.radians(angle_deg)) / scale, np.sin(np.radians(angle_deg)) / scale

    def back(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        dx, dy = x - centre[0], y - centre[1]
        return centre[0] + c * dx - s * dy, centre[1] + s * dx + c * dy

    return back


@pytest.fixture(scope="session")
def turn() -> Callable[..., Warp]:
    """The function `turned`, which returns the function `back` of a turned and enlarged image."""
    return turned
