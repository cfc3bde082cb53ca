"""The export formats, named as on the command line."""

from collections.abc import Callable, Mapping
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple, cast

if TYPE_CHECKING:
    from dic.exports.image import Exporter, ExportSeries


class Format(NamedTuple):
    """The class that writes a format, as text, and what the files are or which program reads them."""

    exporter: str
    about: str


EXPORTS: Mapping[str, Format] = {
    "csv": Format("dic.exports.tables:CsvExporter", "tables"),
    "tiff": Format("dic.exports.tiff:TiffExporter", "one picture of floating point per value and image"),
    "vtk": Format("dic.exports.vtk:VtkExporter", "ParaView"),
    "mat": Format("dic.exports.arrays:MatlabExporter", "MATLAB"),
    "npz": Format("dic.exports.arrays:NumpyExporter", "NumPy"),
    "netcdf": Format("dic.exports.netcdf:NetcdfExporter", "xarray"),
    "dice": Format("dic.exports.dice:DiceExporter", "text in the columns of DICe"),
}
"""The formats by their names; the class of a format is imported only when the format is used."""


def exporter_of(name: str) -> "Callable[[Path, ExportSeries], Exporter]":
    """Return the class that writes a format."""
    module, attribute = EXPORTS[name].exporter.split(":")
    return cast("Callable[[Path, ExportSeries], Exporter]", getattr(import_module(module), attribute))
