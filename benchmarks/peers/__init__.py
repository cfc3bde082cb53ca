"""Other engines from the package index, each in a virtual environment of its own."""

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
    """An engine, and how it is asked to correlate.

    Attributes
    ----------
    label : str
    package : str
        Its name and version at the package index.
    script : str
        The file of this folder that its interpreter runs.
    step_px : int
        Distance of its points; slow engines get fewer, for their speed per point hardly depends on it.
    shape, order : str, int
    smooth : bool
        Whether it may smooth the images, as it does by default.
    margin_px : int
        Width of the frame without points.
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
    # Its equations grow with the square of the nodes, so it gets the middle of the image only.
    Peer("muDIC, elements", "muDIC", "run_mudic.py", 21, margin_px=300),
)


@dataclass(frozen=True)
class PeerResult:
    """What a peer found in one call: points and displacements (n, 2), and how long the call took."""

    points: Float
    moved: Float
    cpu_s: float
    wall_s: float


class Unavailable(Exception):
    """A peer could not be installed or run; the message says why."""


def install(peer: Peer) -> Path:
    """Return the interpreter of the peer's own virtual environment, made on first use.

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
    """Return the installed version of an installed peer."""
    name = peer.package.split("=")[0]
    command = [str(install(peer)), "-c", f"import importlib.metadata as m; print(m.version({name!r}))"]
    return _call(command, "ask").strip()


def correlate(
    peer: Peer, folder: Path, pair: tuple[NDArray[np.uint8], NDArray[np.uint8]], subset_px: int
) -> PeerResult:
    """Let a peer correlate a pair on one thread; `folder` is for its files.

    Raises
    ------
    Unavailable
        If it fails.
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
    """Run a command, where peers may leave their logs, and return what it prints."""
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
