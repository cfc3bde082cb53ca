"""Other correlation programs ("peers") from the package index, each in its own virtual environment."""

import json
import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from dic.typing import Float

_LIBRARIES = ("OMP", "OPENBLAS", "MKL", "NUMBA")
_ONE_THREAD = {f"{library}_NUM_THREADS": "1" for library in _LIBRARIES}


@dataclass(frozen=True)
class Peer:
    """A correlation program, and the settings with which it correlates.

    Attributes
    ----------
    label : str
    package : str
        Name of the program's package, with its version, at the package index.
    script : str
        The file in this folder that the interpreter of the program's environment runs.
    step_px : int
        Distance of the points. Slow programs get fewer points, because the number of points hardly changes
        the speed per point.
    shape, order : str, int
    smooth : bool
        True if the program smooths the images, as it does by default.
    margin_px : int
        Width of the margin at the edges of the image in which there are no points.
    """

    label: str
    package: str
    script: str
    step_px: int
    shape: str = "affine"
    order: int = 3
    smooth: bool = False
    margin_px: int = 32


PEERS = (
    Peer("pyvale", "pyvale==2026.10.*", "run_pyvale.py", 5),
    Peer("pyvale, its smoothing", "pyvale==2026.10.*", "run_pyvale.py", 10, smooth=True),
    Peer("pyvale", "pyvale==2026.10.*", "run_pyvale.py", 10, shape="quadratic"),
    Peer("SUN-DIC", "SUN-DIC", "run_sundic.py", 20),
    Peer("SUN-DIC", "SUN-DIC", "run_sundic.py", 20, order=5),
    # The size of muDIC's equations grows with the square of the number of nodes, so muDIC correlates only the
    # middle of the image.
    Peer("muDIC, elements", "muDIC", "run_mudic.py", 21, margin_px=300),
)


@dataclass(frozen=True)
class PeerResult:
    """Result of one call of a peer: points and displacements, shapes (n, 2), and the times of the call."""

    points: Float
    moved: Float
    cpu_s: float
    wall_s: float


class Unavailable(Exception):
    """A peer could not be installed or run; the message gives the reason."""


def install(peer: Peer) -> Path:
    """Return the Python interpreter of a peer's virtual environment, which is created at its first use.

    Raises
    ------
    Unavailable
        If the package cannot be installed.
    """
    folder = _cache() / peer.package.split("=")[0].lower()
    python = folder / "bin" / "python"
    installed = folder / "installed"
    if not installed.exists():
        for command in (
            [sys.executable, "-m", "venv", "--clear", str(folder)],
            [str(python), "-m", "pip", "install", "--quiet", "--disable-pip-version-check", peer.package],
        ):
            _call(command, "install")
        installed.touch()
    return python


def version(peer: Peer) -> str:
    """Return the version of a peer's package, which is installed first if necessary."""
    name = peer.package.split("=")[0]
    command = [str(install(peer)), "-c", f"import importlib.metadata as m; print(m.version({name!r}))"]
    return _call(command, "ask").strip()


def correlate(
    peer: Peer, folder: Path, pair: tuple[NDArray[np.uint8], NDArray[np.uint8]], subset_px: int
) -> PeerResult:
    """Let a peer correlate a pair of images on one thread; the peer writes its files to `folder`.

    Raises
    ------
    Unavailable
        If the peer cannot be installed, or fails.
    """
    names = "reference.tif", "deformed.tif"
    for name, image in zip(names, pair, strict=True):
        Image.fromarray(image).save(folder / name)
    job = {
        "folder": str(folder), "images": names, "size": pair[0].shape, "margin": peer.margin_px,
        "subset": subset_px, "step": peer.step_px, "shape": peer.shape, "order": peer.order,
        "smooth": peer.smooth, "threads": 1, "result": "result.npz",
    }  # fmt: skip
    (folder / "job.json").write_text(json.dumps(job))
    script = Path(__file__).with_name(peer.script)
    _call([str(install(peer)), str(script), str(folder / "job.json")], "run", folder, _ONE_THREAD)
    with np.load(folder / "result.npz") as found:
        return PeerResult(found["points"], found["moved"], float(found["cpu_s"]), float(found["wall_s"]))


def _cache() -> Path:
    caches = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return caches / "offaxis" / "peers"


def _call(
    command: list[str], what: str, folder: Path | None = None, environment: dict[str, str] | None = None
) -> str:
    """Run a command in a folder to which peers may write their logs, and return the printed text."""
    try:
        done = subprocess.run(
            command, capture_output=True, text=True, timeout=1200, cwd=folder,
            env={**os.environ, **(environment or {})},
        )  # fmt: skip
    except (OSError, subprocess.TimeoutExpired) as error:
        raise Unavailable(f"{what}: {error}") from error
    if done.returncode:
        lines = done.stderr.strip().splitlines() or ["no message"]
        raise Unavailable(f"{what}: {lines[-1]}")
    return done.stdout
