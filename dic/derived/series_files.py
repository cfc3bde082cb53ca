"""The output files of `dic correlate`. Each kind of file is written only if the user names a place for it."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from dic.correlation.settings import CorrelationSettings
from dic.derived.gauge_series import GaugeReader
from dic.derived.series_maps import MapFiles, SeriesMaps
from dic.exports.image import stem_of, unique_names
from dic.gauges.declared import Gauge
from dic.gauges.series import GaugeImage, GaugeSeries
from dic.gauges.table import gauge_table_files, write_gauge_table
from dic.pipeline.measured_images import MeasuredImage
from dic.results.csv import write_csv
from dic.results.strain_table import STRAIN_FILE, write_strain_table

GAUGE_FILE = "gauges.csv"


class SeriesFiles:
    """The paths of the output files of a series of images.

    If several images have the same name, for example in different folders, the names of their output files
    begin with the number of the image.

    Attributes
    ----------
    folders : list of path
        Folders for tables and maps. The folders need not exist before `make_folders` is called.
    """

    def __init__(
        self,
        output: Path | None,
        csv_folder: Path | None,
        maps_folder: Path | None,
        deformed: Sequence[Path],
        map_format: str = "png",
        sheets: Mapping[str, Path] | None = None,
        gauges: Sequence[Gauge] = (),
    ) -> None:
        self.folders = [folder for folder in (csv_folder, maps_folder) if folder is not None]
        stems = list(map(stem_of, deformed))
        tables = [] if csv_folder is None else gauge_table_files(csv_folder / GAUGE_FILE, gauges)
        self.gauges, self.gauge_tables = tuple(gauges), tables if gauges else []
        # The tables of strains and gauges are beside the tables of points.
        taken = [Path(STRAIN_FILE).stem, *(path.stem for path in self.gauge_tables)]
        names = unique_names(stems, taken)
        self.output = output
        self.strains = None if csv_folder is None else csv_folder / STRAIN_FILE
        self.csv = [] if csv_folder is None else [csv_folder / f"{name}.csv" for name in names]
        maps = [] if maps_folder is None else [maps_folder / f"{name}.{map_format}" for name in names]
        self.pictures = MapFiles(maps, sheets or {})

    def make_folders(self) -> None:
        """Make the missing folders. Call this after all checks, so that an error leaves no empty folder."""
        for folder in self.folders:
            folder.mkdir(parents=True, exist_ok=True)

    def all(self) -> list[Path]:
        """Return the paths of all output files of the series."""
        single = [path for path in (self.output, self.strains) if path is not None]
        return [*single, *self.gauge_tables, *self.csv, *self.pictures.all()]


class SeriesOutputs:
    """A writer that adds the images of a series to its output files one by one."""

    def __init__(
        self,
        settings: CorrelationSettings,
        files: SeriesFiles,
        maps: SeriesMaps,
        gauges: GaugeReader | None = None,
        *,
        decimal_comma: bool = False,
    ) -> None:
        self._settings, self._files, self._decimal_comma = settings, files, decimal_comma
        self._maps, self._reader = maps, gauges
        self.gauge_images: dict[int, GaugeImage] = {}

    def write(self, number: int, image: MeasuredImage) -> None:
        """Write a measured image to its output files; `number` is its index in the series, from 0."""
        measurement, correction = image.measurement, image.correction
        if self._reader is not None:
            self.gauge_images[number] = self._reader.read(image)
        if measurement is None:
            return
        if self._files.csv:
            path, comma = self._files.csv[number], self._decimal_comma
            write_csv(measurement, path, correction=correction, decimal_comma=comma)
        name = Path(measurement.label).name
        title = f"{name}, subset {self._settings.subset_px} px, step {self._settings.step_px} px"
        self._maps.add(number, title, measurement, correction)

    @property
    def gauge_series(self) -> GaugeSeries:
        """The readings of the gauges in the images that were written."""
        images = tuple(self.gauge_images[number] for number in sorted(self.gauge_images))
        return GaugeSeries("", self._files.gauges, images)

    def write_table(self, rows: Sequence[Mapping[str, Any]]) -> None:
        """Write the tables of mean strains (see `write_strain_table` for the rows) and of gauges."""
        if self._files.strains is not None:
            write_strain_table(rows, self._files.strains, decimal_comma=self._decimal_comma)
        if self._files.gauge_tables and self.gauge_images:
            path, comma = self._files.gauge_tables[0], self._decimal_comma
            write_gauge_table(self.gauge_series, path, decimal_comma=comma)
