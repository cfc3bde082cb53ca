"""Export for ParaView: a structured grid per image (.vts), and a file that orders them in time (.pvd).

Source of the format: "VTK File Formats", chapter on XML files. Each array is in the file itself: its length
(64 bits) and its values, in base64.
"""

import base64
from typing import Any
from xml.sax.saxutils import escape, quoteattr

import numpy as np
from numpy.typing import NDArray

from dic.exports.image import FIXED, Exporter, ExportImage, file_name
from dic.files.writing import write_text
from dic.results.points import CORRECTED, PointValues
from dic.results.schema import units_of
from dic.typing import Float

_HIDDEN = 2
"""The bit HIDDENPOINT of the array vtkGhostType; ParaView does not draw points with this bit."""
_TYPES = {"f8": "Float64", "u1": "UInt8"}


class VtkExporter(Exporter):
    """Writes the grid of points in mm, or in px if there is no calibration, always with y upwards.

    Points without a displacement are hidden. Displacements are also written as vectors, for ParaView's filter
    "Warp By Vector".
    """

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self._times: list[tuple[int, float | None, str]] = []

    def add(self, image: ExportImage) -> None:
        """Write an image."""
        name = f"{image.name}.vts"
        write_text(self.folder / name, grid_text(image.points))
        self._times.append((image.number, image.known.get("time_s"), name))

    def finish(self) -> None:
        """Write the file that orders the images: by time if the times always increase, else by number."""
        known = [time for _, time, _ in self._times if time is not None]
        timed = len(known) == len(self._times) and all(np.diff(known) > 0.0)
        lines = [
            f'  <DataSet timestep="{time if timed else number}" part="0" file={quoteattr(name)}/>\n'
            for number, time, name in self._times
        ]
        text = _file("Collection", "<Collection>\n" + "".join(lines) + "</Collection>\n")
        write_text(self.folder / f"{file_name(self.series.name)}.pvd", text)


def grid_text(points: PointValues) -> str:
    """Return a structured grid with all values at its points, as XML."""
    rows, columns = points.active.shape
    extent = f"0 {columns - 1} 0 {rows - 1} 0 0"
    values = {name: value for name, value in points.values.items() if name not in FIXED}
    arrays = [_array(name, np.where(points.active, value, np.nan)) for name, value in values.items()]
    x_px, y_px = np.meshgrid(points.x_px, points.y_px)
    arrays += [_array("x_px", x_px), _array("y_px", y_px)]
    vectors = _displacements(points)
    arrays += [_array(name, vector) for name, vector in vectors.items()]
    hidden = np.where(points.converged, 0, _HIDDEN).astype(np.uint8)
    arrays.append(_array("vtkGhostType", hidden))
    label = " ".join(str(byte) for byte in [*points.label.encode(), 0])
    content = (
        f'<StructuredGrid WholeExtent="{extent}">\n<FieldData>\n'
        f'<DataArray type="String" Name="label" NumberOfTuples="1" format="ascii">{label}</DataArray>\n'
        f'</FieldData>\n<Piece Extent="{extent}">\n<PointData Vectors="{next(iter(vectors))}">\n'
        f"{''.join(arrays)}</PointData>\n<CellData/>\n"
        f"<Points>\n{_array('places', _places(points))}</Points>\n"
        "</Piece>\n</StructuredGrid>\n"
    )
    return _file("StructuredGrid", content)


def _places(points: PointValues) -> Float:
    """Return the positions of all points, in mm or px, y upwards, shape (rows, columns, 3)."""
    x_px, y_px = np.meshgrid(points.x_px.astype(np.float64), points.y_px.astype(np.float64))
    x, y = points.values.get("X_mm", x_px), points.values.get("Y_mm", -y_px)
    return np.stack([_filled(x, x_px, y_px), _filled(y, x_px, y_px), np.zeros_like(x_px)], axis=-1)


def _filled(values: Float, x_px: Float, y_px: Float) -> Float:
    """Replace unknown coordinates by a plane fitted to the known coordinates; such points are hidden."""
    known = np.isfinite(values)
    if known.all() or not known.any():
        return np.nan_to_num(values)
    terms = np.stack([np.ones_like(x_px), x_px, y_px], axis=-1)
    plane, *_ = np.linalg.lstsq(terms[known], values[known], rcond=None)
    return np.where(known, values, terms @ plane)


def _displacements(points: PointValues) -> dict[str, Float]:
    """Return the displacements as vectors, y upwards, shape (rows, columns, 3)."""
    values = points.values
    found = {"displacement_px": ("u_px", "v_px", -1.0)}
    if "U_mm" in values:
        found = {"displacement_mm": ("U_mm", "V_mm", 1.0)}
    if f"{CORRECTED}U_mm" in values:
        found[f"{CORRECTED}displacement_mm"] = (f"{CORRECTED}U_mm", f"{CORRECTED}V_mm", 1.0)
    vectors = {}
    for name, (along_x, along_y, sign) in found.items():
        parts = [values[along_x], sign * values[along_y], np.zeros(points.active.shape)]
        vectors[name] = np.where(points.converged[..., None], np.stack(parts, axis=-1), 0.0)
    return vectors


def _array(name: str, values: NDArray[Any]) -> str:
    kind = "u1" if values.dtype == np.uint8 else "f8"
    data = np.ascontiguousarray(values, f"<{kind}").tobytes()
    text = base64.b64encode(np.array(len(data), "<u8").tobytes() + data).decode()
    parts = f' NumberOfComponents="{values.shape[2]}"' if values.ndim == 3 else ""
    unit, key = units_of(name), 'InformationKey name="UNITS_LABEL" location="vtkDataArray"'
    information = "" if unit == "1" else f"<{key}>{unit}</InformationKey>\n"
    head = f'<DataArray type="{_TYPES[kind]}" Name="{escape(name)}"{parts} format="binary">'
    # Readers expect the values directly behind the opening tag.
    return f"{head}\n{text}\n{information}</DataArray>\n"


def _file(kind: str, content: str) -> str:
    head = f'<VTKFile type="{kind}" version="1.0" byte_order="LittleEndian" header_type="UInt64">'
    return f'<?xml version="1.0"?>\n{head}\n{content}</VTKFile>\n'
