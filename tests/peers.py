"""Programs by other authors for tests, each Python program in its own virtual environment."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

INSTALL_S = 300
RUN_S = 120
MARK = "installed"


def interpreter(name: str, *packages: str) -> Path:
    """Return the Python interpreter of an environment with the given packages, which is made only once.

    If the packages cannot be installed, the test is skipped with the reason.
    """
    caches = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    folder = caches / "offaxis" / "peers" / name
    wanted = " ".join(packages)
    if not _holds(folder, wanted):
        making = folder.with_name(f"{name}-{os.getpid()}")
        for command in (
            [sys.executable, "-m", "venv", "--clear", str(making)],
            [str(making / "bin" / "python"), "-m", "pip", "install", "-q", "--prefer-binary", *packages],
        ):
            _install(command, making, packages)
        (making / MARK).write_text(wanted)
        _put_in_place(making, folder, wanted)
    return folder / "bin" / "python"


def _holds(folder: Path, wanted: str) -> bool:
    mark = folder / MARK
    return mark.exists() and mark.read_text() == wanted


def _put_in_place(making: Path, folder: Path, wanted: str) -> None:
    """Rename a finished environment to its final path, unless another worker has made the same one."""
    if folder.exists() and not _holds(folder, wanted):
        shutil.rmtree(folder)
    try:
        making.rename(folder)
    except OSError:
        shutil.rmtree(making)


def _install(command: list[str], folder: Path, packages: tuple[str, ...]) -> None:
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=INSTALL_S)
        reason = (done.stderr.strip().splitlines() or ["no message"])[-1] if done.returncode else ""
    except (OSError, subprocess.TimeoutExpired) as error:
        reason = str(error)
    if reason:
        shutil.rmtree(folder, ignore_errors=True)
        pytest.skip(f"{', '.join(packages)} cannot be installed: {reason}")


def program(name: str, package: str) -> str:
    """Return the path of a program; if it is not installed, the test is skipped with the reason."""
    path = shutil.which(name)
    if path is None:
        pytest.skip(f"{name} is not on this machine (Debian: {package})")
    return path


def run(*command: str | Path) -> str:
    """Run a program to its end and return the printed text; if it fails, the test fails with its message."""
    done = subprocess.run([str(part) for part in command], capture_output=True, text=True, timeout=RUN_S)
    assert done.returncode == 0, f"{done.stdout}\n{done.stderr}"
    return done.stdout
