"""Export as CSV: one table of points per image, and the table of mean strains of all images."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from dic.exports.image import Exporter, ExportImage, ExportSeries
from dic.results.csv import write_points
from dic.results.strain_table import STRAIN_FILE, write_strain_table


class CsvExporter(Exporter):
    """Writes the same tables as `dic correlate --csv`; for a run, with the best correction of each step.

    Parameters
    ----------
    folder, series
        As for `Exporter`.
    rows : list
        The rows of the table of mean strains; each image appends its row to this list.
    decimal_comma : bool
        True for numbers with a decimal comma and semicolons between cells.
    """

    def __init__(
        self,
        folder: Path,
        series: ExportSeries,
        rows: list[Mapping[str, Any]],
        *,
        decimal_comma: bool = False,
    ) -> None:
        super().__init__(folder, series)
        self._rows, self._comma = rows, decimal_comma

    def add(self, image: ExportImage) -> None:
        """Write an image."""
        write_points(image.points, self.folder / f"{image.name}.csv", decimal_comma=self._comma)

    def finish(self) -> None:
        """Write the table of mean strains."""
        write_strain_table(self._rows, self.folder / STRAIN_FILE, decimal_comma=self._comma)
