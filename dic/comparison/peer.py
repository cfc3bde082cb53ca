"""The results of another program for one pair of images, in the axes and units of offaxis."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dic.errors import RunFileError
from dic.typing import Float, Mask

MOST_BYTES = 2**30
"""Largest size of a result file of another program."""
COMPONENTS = ("exx", "eyy", "exy")


@dataclass(frozen=True)
class PeerField:
    """The results of another program for one pair of images.

    Attributes
    ----------
    program : str
        "DICe", "Ncorr" or "OpenCorr".
    source : str
        The file, for messages.
    points_px : ndarray, shape (n, 2)
        Places in the reference image: x to the right, y downwards, the middle of the first pixel at 0.
    u_px, v_px : ndarray, shape (n,)
        Displacement in image axes, v positive downwards.
    strains : mapping of str to ndarray, shape (n,)
        The strains "exx", "eyy" and "exy", if the file has them, in axes with y upwards; NaN at points
        without strain.
    measure : str
        Strain measure of `strains`: "green-lagrange", "small", or "hencky" in an export of offaxis.
    image : str
        Name of the deformed image; empty if the file does not name it.
    """

    program: str
    source: str
    points_px: Float
    u_px: Float
    v_px: Float
    strains: Mapping[str, Float]
    measure: str
    image: str = ""

    def __len__(self) -> int:
        return len(self.u_px)

    def __repr__(self) -> str:
        return f"PeerField({self.program}, {self.source!r}, {len(self)} points)"


def field_of(
    program: str, path: Path, columns: Mapping[str, Float], use: Mask, measure: str, image: str = ""
) -> PeerField:
    """Return the results of another program at the points that this program could measure.

    `columns`, each of shape (n,): x, y, u, v in px and the strains, all in image axes with y downwards.
    `use`, shape (n,): True for the points that the program could measure.

    Raises `RunFileError` if the program could measure no point.
    """
    use = use & np.isfinite([columns[name] for name in "xyuv"]).all(axis=0)
    if not use.any():
        raise wrong(path, "at least one point with a displacement", "none", "correlate again")
    strains = {name: columns[name][use] for name in COMPONENTS if name in columns}
    if strains:
        # A program that has not computed strain fills it with zeros.
        empty = np.all([values == 0.0 for values in strains.values()], axis=0)
        strains = {name: np.where(empty, np.nan, values) for name, values in strains.items()}
    if "exy" in strains:
        # The shear strain changes its sign with the direction of y.
        strains["exy"] = -strains["exy"]
    points = np.stack([columns["x"][use], columns["y"][use]], axis=-1)
    return PeerField(
        program, str(path), points, columns["u"][use], columns["v"][use], strains, measure, image
    )


def wrong(path: Path, expected: str, got: str, remedy: str) -> RunFileError:
    """Return an error about a result file of another program."""
    return RunFileError(str(path), "read results of another program", expected, got, remedy)
