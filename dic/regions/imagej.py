"""Read the areas that ImageJ's ROI Manager saves: .roi files, and .zip files that contain several."""

import io
import struct
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from dic.errors import CorrelationError
from dic.files.reading import MOST_TEXT_BYTES, read_bytes
from dic.typing import Float

if TYPE_CHECKING:
    from roifile import ImagejRoi

_CORNER_OF_PIXEL = 0.5
"""ImageJ counts coordinates of areas from the corner of the first pixel; offaxis counts from its centre."""

_SAGITTA_PX = 0.02
"""Largest distance between an oval and the polygon that replaces it."""

_MOST_MEMBERS = 10_000
"""Largest number of files in a .zip file."""

_EXPECTED = "areas of ImageJ: polygons, freehand and traced areas, rectangles, ovals"


def imagej_areas(path: Path) -> list[tuple[str, Float]]:
    """Return the outlines in a .roi file, or in a .zip file of several, with a label for each.

    Coordinates are counted from the centre of the first pixel, as everywhere in offaxis: The coordinate 10.5
    of an area in ImageJ is 10 in offaxis. An oval becomes a polygon that follows the oval within 0.02 px.

    `path`: a file with the ending .roi or .zip.

    Result: label for error messages, and corners (corners, 2) in px.

    Raises `OSError` if the file cannot be read, and `CorrelationError` if the file is damaged or contains a
    selection that is no area, such as a line, a point or a text.
    """
    content = read_bytes(path)
    members = [(str(path), content)] if path.suffix.lower() == ".roi" else list(_members(path, content))
    found = []
    for label, data in members:
        outlines = _outlines(label, _decoded(label, data))
        several = len(outlines) > 1
        found += [
            (f"{label}, part {k}" if several else label, corners) for k, corners in enumerate(outlines, 1)
        ]
    return found


def _members(path: Path, content: bytes) -> Iterator[tuple[str, bytes]]:
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            members = archive.infolist()
            if len(members) > _MOST_MEMBERS:
                raise _refusal(str(path), f"{len(members)} files, more than {_MOST_MEMBERS}")
            for member in members:
                label = f"{path}, {member.filename}"
                if not member.filename.lower().endswith(".roi"):
                    raise _refusal(label, "a file without the ending .roi", "leave other files out of it")
                with archive.open(member) as file:
                    data = file.read(MOST_TEXT_BYTES + 1)
                if len(data) > MOST_TEXT_BYTES:
                    raise _refusal(label, f"a file of more than {MOST_TEXT_BYTES / 2**20:.0f} MB")
                yield label, data
    # For a damaged or encrypted file in the archive, zipfile raises one of these errors.
    except (zipfile.BadZipFile, EOFError, RuntimeError, NotImplementedError, ValueError) as error:
        raise _refusal(str(path), f"a damaged .zip file ({error})", "save it again in ImageJ") from error


def _decoded(label: str, data: bytes) -> "ImagejRoi":
    from roifile import ImagejRoi

    try:
        return ImagejRoi.frombytes(data)
    except (ValueError, TypeError, IndexError, struct.error) as error:
        got = f"a damaged file ({' '.join(str(error).split())})"
        raise _refusal(label, got, "save it again in ImageJ") from error


def _outlines(label: str, roi: "ImagejRoi") -> list[Float]:
    """Return the outlines of an area, counted from the centre of the first pixel."""
    from roifile import ROI_OPTIONS, ROI_SUBTYPE, ROI_TYPE

    rounded = roi.roitype == ROI_TYPE.RECT and not roi.composite and roi.rounded_rect_arc_size > 0
    if roi.subtype not in (ROI_SUBTYPE.UNDEFINED, ROI_SUBTYPE.ELLIPSE, ROI_SUBTYPE.ROTATED_RECT):
        raise _refusal(label, f"a selection of the kind {roi.subtype.name.lower()}")
    if roi.options & ROI_OPTIONS.SPLINE_FIT or rounded:
        got = "a rectangle with rounded corners" if rounded else "a spline through the corners"
        raise _refusal(label, got, "make a polygon of it by Edit > Selection > Interpolate in ImageJ")
    if roi.composite:
        outlines = _composite(label, roi)
    elif roi.roitype == ROI_TYPE.OVAL:
        outlines = [_oval(*_box(roi))]
    elif roi.roitype == ROI_TYPE.RECT:
        left, top, right, bottom = _box(roi)
        outlines = [np.array([[left, top], [right, top], [right, bottom], [left, bottom]])]
    elif roi.roitype in (ROI_TYPE.POLYGON, ROI_TYPE.FREEHAND, ROI_TYPE.TRACED):
        outlines = [np.asarray(roi.coordinates(), np.float64)]
    else:
        raise _refusal(label, f"a selection of the kind {roi.roitype.name.lower()}")
    return [_open(corners) - _CORNER_OF_PIXEL for corners in outlines]


def _composite(label: str, roi: "ImagejRoi") -> list[Float]:
    """Return the outlines of an area of several parts, some of which may be holes in others."""
    try:
        parts = roi.coordinates(multi=True)
    # roifile reads only straight edges of such areas, and raises this error for curved ones.
    except NotImplementedError as error:
        remedy = "make a polygon of it by Edit > Selection > Interpolate in ImageJ"
        raise _refusal(label, "an area of several parts with curved edges", remedy) from error
    except (RuntimeError, IndexError, ValueError) as error:
        raise _refusal(label, f"a damaged file ({error})", "save it again in ImageJ") from error
    return [np.asarray(part, np.float64) for part in parts]


def _open(corners: Float) -> Float:
    """Return the corners without the repeated first corner that closes some outlines."""
    closed = len(corners) > 3 and np.array_equal(corners[0], corners[-1])
    return corners[:-1] if closed else corners


def _box(roi: "ImagejRoi") -> tuple[float, float, float, float]:
    """Return the left, upper, right and lower edge of a rectangle or an oval."""
    if roi.subpixelrect:
        return roi.xd, roi.yd, roi.xd + roi.widthd, roi.yd + roi.heightd
    return float(roi.left), float(roi.top), float(roi.right), float(roi.bottom)


def _oval(left: float, top: float, right: float, bottom: float) -> Float:
    radii = 0.5 * np.array([right - left, bottom - top])
    longest = max(float(np.abs(radii).max()), 2 * _SAGITTA_PX)
    count = max(8, int(np.ceil(np.pi / np.arccos(1.0 - _SAGITTA_PX / longest))))
    angle = np.linspace(0.0, 2.0 * np.pi, count, endpoint=False)
    middle = 0.5 * np.array([left + right, top + bottom])
    return np.asarray(middle + radii * np.stack([np.cos(angle), np.sin(angle)], axis=1))


def _refusal(
    label: str, got: str, remedy: str = "save only areas in ImageJ's ROI Manager"
) -> CorrelationError:
    return CorrelationError(label, "read region of interest", _EXPECTED, got, remedy)
