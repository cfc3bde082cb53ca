"""Where results come from: the program, its command, and the digests of its input files."""

import shlex
import sys
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cache
from importlib.metadata import version
from pathlib import Path

from dic.files.digest import file_sha256
from dic.results.job import Job

_PACKAGES = ("offaxis", "numpy", "scipy", "numba", "opencv-python-headless")


@dataclass(frozen=True)
class Provenance:
    """Where the results of a file come from."""

    command: str
    """The command line of the program that wrote the results."""
    versions: str
    """The versions of this program and of the libraries that it computes with."""
    inputs: Mapping[str, str]
    """The SHA-256 of each input file except the images of a series, keyed by the file's name."""
    job: Job | None = None
    """Everything except the images that determines the results; None for files of earlier versions."""

    @classmethod
    def of(
        cls,
        inputs: Iterable[Path | None],
        job: Job | None = None,
        digest: Callable[[Path], str] | None = None,
    ) -> "Provenance":
        """Return the provenance of results that this program computes from files.

        `inputs`: the input files except the images of a series; None means "no file". `digest`: function that
        returns the SHA-256 of a file, for a caller that already knows some digests.
        """
        program, *arguments = sys.argv
        of_file = digest or file_sha256
        digests = {str(path): of_file(path) for path in inputs if path is not None}
        return cls(shlex.join([Path(program).name, *arguments]), versions(), digests, job)


@cache
def versions() -> str:
    """Return the versions of this program and of the libraries that it computes with, as one line of text."""
    return ", ".join(f"{name} {version(name)}" for name in _PACKAGES)
