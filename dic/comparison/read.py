"""Reads a result file of another program; the content of the file shows which program wrote it."""

from pathlib import Path

from dic.comparison.ncorr import is_matlab, read_ncorr
from dic.comparison.peer import PeerField, wrong
from dic.comparison.texts import program_of_text, read_dice, read_opencorr
from dic.strain.measures import MEASURES
from dic.typing import PathLike


def read_peer(path: PathLike, *, number: int = 1, measure: str | None = None) -> PeerField:
    """Read a result file of DICe (text), Ncorr (.mat) or OpenCorr (table of points of interest).

    Parameters
    ----------
    path : path
    number : int
        Number of the image in a file of Ncorr, from 1. Other files have one image.
    measure : str, optional
        Strain measure of a file of OpenCorr, because the file does not name it. Default: "small", OpenCorr's
        own default.

    Raises
    ------
    RunFileError
        If the file cannot be read, or none of these programs wrote it.
    """
    path = Path(path)
    program = "Ncorr" if is_matlab(path) else program_of_text(path)
    if measure is not None and program != "OpenCorr":
        expected, remedy = "a file of OpenCorr, which does not name its strain", "leave out --peer-strain"
        raise wrong(path, expected, f"one of {program}", remedy)
    if measure is not None and measure not in MEASURES:
        remedy = "give green-lagrange or small"
        raise wrong(path, f"a strain measure, one of {', '.join(MEASURES)}", measure, remedy)
    if program == "Ncorr":
        return read_ncorr(path, number)
    if number != 1:
        raise wrong(path, "image 1, because the file has no other", str(number), "leave out --peer-image")
    if program == "DICe":
        return read_dice(path)
    return read_opencorr(path, measure or "small")
