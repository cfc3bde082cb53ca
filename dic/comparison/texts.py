"""Reads the text files of DICe and OpenCorr.

DICe (Sandia; dicengine on GitHub): comment lines begin with three stars. The comments say that x points to
the right and y downwards, with 0,0 at the upper left. `VSG_Strain_Post_Processor` in `DICe_PostProcessor.cpp`
computes Green-Lagrange strain in these axes. Points that failed have SIGMA, GAMMA or MATCH of -1.

OpenCorr (Jiang, on GitHub): `oc_io.cpp` writes one line per point of interest, with any separator. x and y
are the columns and rows of the image, from 0 at the upper left. `oc_strain.cpp` computes small strain by
default, and Green-Lagrange strain if the user asks for it. Points that failed have a negative ZNCC.
"""

import re
from pathlib import Path

import numpy as np

from dic.comparison.peer import MOST_BYTES, PeerField, field_of, wrong
from dic.files.reading import read_bytes
from dic.typing import Float

_DICE = {
    "COORDINATE_X": "x", "COORDINATE_Y": "y", "DISPLACEMENT_X": "u", "DISPLACEMENT_Y": "v",
    "VSG_STRAIN_XX": "exx", "VSG_STRAIN_YY": "eyy", "VSG_STRAIN_XY": "exy",
}  # fmt: skip
_DICE_FAILED = ("SIGMA", "GAMMA", "MATCH")
_OFFAXIS_STRAIN = re.compile(r"^\*\*\* Strain: ([\w-]+), (\w+);", re.MULTILINE)
"""The comment in which an export of offaxis names the measure and the kind of its strain."""
_OPENCORR = {name: name for name in ("x", "y", "u", "v", "exx", "eyy", "exy")}
_SEPARATORS = (",", ";", "\t", "|", " ")
_REMEDY = "give a result file of DICe, Ncorr or OpenCorr"


def read_dice(path: Path) -> PeerField:
    """Read a solution file of DICe.

    Raises `RunFileError` if the file cannot be read, lacks a column, gives displacements relative to the
    previous image, or is an export of offaxis with calibrated strain.
    """
    lines = _lines(path)
    comments = [line for line in lines if line.startswith("***")]
    if any(re.search(r"Incremental correlation:\s*true", line) for line in comments):
        expected, remedy = "displacements since the reference", "correlate without incremental formulation"
        raise wrong(path, expected, "incremental correlation", remedy)
    columns = _columns(path, [line for line in lines if not line.startswith("***")])
    known = _renamed(path, columns, _DICE)
    use = np.ones(len(known["x"]), np.bool_)
    for name in _DICE_FAILED:
        use &= ~(columns.get(name, np.zeros(1)) < 0.0)
    images = [line.partition("Deformed image:")[2].strip() for line in comments if "Deformed image:" in line]
    own = _OFFAXIS_STRAIN.search("\n".join(comments))
    measure, kind = ("green-lagrange", "raw") if own is None else own.groups()
    if kind != "raw":
        remedy = "export the results again with --raw-strain"
        raise wrong(path, "raw strain, in the axes of the image", f"{kind} strain", remedy)
    return field_of("DICe", path, known, use, measure, images[0] if images else "")


def read_opencorr(path: Path, measure: str = "small") -> PeerField:
    """Read a table of points of interest of OpenCorr.

    Raises `RunFileError` if the file cannot be read or lacks a column.
    """
    columns = {name.lower(): values for name, values in _columns(path, _lines(path)).items()}
    known = _renamed(path, columns, _OPENCORR)
    use = ~(columns.get("zncc", np.zeros(1)) < 0.0) & np.ones(len(known["x"]), np.bool_)
    return field_of("OpenCorr", path, known, use, measure)


def program_of_text(path: Path) -> str:
    """Return which program wrote a text file: "DICe" or "OpenCorr".

    Raises `RunFileError` if neither program wrote the file, or the file cannot be read.
    """
    for line in _lines(path):
        if line.startswith("***") or "COORDINATE_X" in line:
            return "DICe"
        if re.match(r"x\W+y\W", line):
            return "OpenCorr"
        break
    raise wrong(path, "columns of DICe or OpenCorr in the first line", "other text", _REMEDY)


def _lines(path: Path) -> list[str]:
    try:
        text = read_bytes(path, MOST_BYTES).decode("utf-8-sig")
    except OSError as error:
        raise wrong(path, "a file that can be read", str(error.strerror or error), _REMEDY) from error
    except UnicodeDecodeError as error:
        raise wrong(path, "a text", "a file that is no text", _REMEDY) from error
    lines = [line.strip() for line in text.splitlines()]
    return [line for line in lines if line]


def _columns(path: Path, lines: list[str]) -> dict[str, Float]:
    """Return the columns of a table as a dict; its keys are the names in the table's first line."""
    if len(lines) < 2:
        raise wrong(path, "a line of names and lines of numbers", f"{len(lines)} lines", _REMEDY)
    separator = next((each for each in _SEPARATORS if each in lines[0]), ",")
    names, *rows = ([cell.strip() for cell in _cells(line, separator)] for line in lines)
    for number, row in enumerate(rows, 1):
        if len(row) != len(names):
            got = f"{len(row)} in line {number} of the numbers"
            raise wrong(path, f"{len(names)} cells in each line", got, "export the file again")
    try:
        values = np.array(rows, dtype=np.float64)
    except ValueError as error:
        got = " ".join(str(error).split())[-60:]
        raise wrong(path, "numbers below the names", got, "export the file again") from error
    return dict(zip(names, values.T, strict=True))


def _cells(line: str, separator: str) -> list[str]:
    cells = line.split(None if separator == " " else separator)
    # OpenCorr ends each line with the separator.
    return cells[:-1] if len(cells) > 1 and not cells[-1].strip() else cells


def _renamed(path: Path, columns: dict[str, Float], names: dict[str, str]) -> dict[str, Float]:
    missing = [name for name in list(names)[:4] if name not in columns]
    if missing:
        raise wrong(path, f"the column {missing[0]}", f"{', '.join(columns)[:80]}", _REMEDY)
    return {own: columns[name] for name, own in names.items() if name in columns}
