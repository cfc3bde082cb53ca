"""The export formats, named as on the command line."""

from collections.abc import Callable, Mapping
from importlib import import_module
from pathlib import Path
from typing import cast

from dic.exports.image import Exporter, ExportSeries

FORMATS: Mapping[str, str] = {
    "csv": "dic.exports.tables:CsvExporter",
    "tiff": "dic.exports.tiff:TiffExporter",
    "vtk": "dic.exports.vtk:VtkExporter",
    "mat": "dic.exports.arrays:MatlabExporter",
    "npz": "dic.exports.arrays:NumpyExporter",
    "netcdf": "dic.exports.netcdf:NetcdfExporter",
    "dice": "dic.exports.dice:DiceExporter",
}
"""The class that writes each format, as text; a class is imported only when its format is used."""

NewExporter = Callable[[Path, ExportSeries], Exporter]


def exporter_of(name: str) -> NewExporter:
    """Import and return the class that writes a format."""
    module, attribute = FORMATS[name].split(":")
    return cast(NewExporter, getattr(import_module(module), attribute))
