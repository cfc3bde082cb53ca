"""The export formats, named as on the command line."""

from collections.abc import Callable, Mapping
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple, cast

if TYPE_CHECKING:
    from dic.exports.image import Exporter, ExportSeries


class ExportFormat(NamedTuple):
    """The class that writes a format, as text, and what the files are or which program reads them."""

    exporter: str
    about: str


EXPORTS: Mapping[str, ExportFormat] = {
    "csv": ExportFormat("dic.exports.tables:CsvExporter", "tables"),
    "tiff": ExportFormat(
        "dic.exports.tiff:TiffExporter", "one picture of floating point per value and image"
    ),
    "vtk": ExportFormat("dic.exports.vtk:VtkExporter", "ParaView"),
    "mat": ExportFormat("dic.exports.arrays:MatlabExporter", "MATLAB"),
    "npz": ExportFormat("dic.exports.arrays:NumpyExporter", "NumPy"),
    "netcdf": ExportFormat("dic.exports.netcdf:NetcdfExporter", "xarray"),
    "dice": ExportFormat("dic.exports.dice:DiceExporter", "text in the columns of DICe"),
}
"""The formats by their names; the class of a format is imported only when the format is used."""


def exporter_of(name: str) -> "Callable[[Path, ExportSeries], Exporter]":
    """Return the class that writes a format."""
    module, attribute = EXPORTS[name].exporter.split(":")
    return cast("Callable[[Path, ExportSeries], Exporter]", getattr(import_module(module), attribute))
