"""Export as CSV: one table of points per image."""

from pathlib import Path

from dic.exports.image import Exporter, ExportImage, ExportSeries
from dic.results.csv import write_points


class CsvExporter(Exporter):
    """Writes the same tables of points as `dic correlate --csv`.

    With `decimal_comma`, numbers have a decimal comma, and semicolons stand between cells.
    """

    def __init__(self, folder: Path, series: ExportSeries, *, decimal_comma: bool = False) -> None:
        super().__init__(folder, series)
        self._comma = decimal_comma

    def add(self, image: ExportImage) -> None:
        """Write an image."""
        write_points(image.points, self.folder / f"{image.name}.csv", decimal_comma=self._comma)
