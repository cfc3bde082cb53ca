"""The output files of `dic correlate`; each file is written only on request."""

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Self

from dic.correlation.settings import CorrelationSettings
from dic.out_of_plane.correction import Correction
from dic.results.csv import write_csv
from dic.results.maps import write_maps
from dic.results.writer import ResultWriter
from dic.strain.measurement import Measurement
from dic.typing import Grey


class SeriesFiles:
    """The names of a series' output files; each file is written only on request.

    A number distinguishes images of the same name (from several folders, or given twice).
    """

    def __init__(
        self,
        output: Path | None,
        csv_folder: Path | None,
        maps_folder: Path | None,
        deformed: Sequence[Path],
    ) -> None:
        for folder in (csv_folder, maps_folder):
            if folder is not None:
                folder.mkdir(parents=True, exist_ok=True)
        stems = Counter(path.stem for path in deformed)
        names = [
            f"{number:04d}_{path.stem}" if stems[path.stem] > 1 else path.stem
            for number, path in enumerate(deformed, 1)
        ]
        self.output = output
        self.csv = [] if csv_folder is None else [csv_folder / f"{name}.csv" for name in names]
        self.maps = [] if maps_folder is None else [maps_folder / f"{name}.png" for name in names]

    def all(self) -> list[Path]:
        """Return every file of the series."""
        return [*([] if self.output is None else [self.output]), *self.csv, *self.maps]


class SeriesOutputs:
    """Writes the files of a series, image by image."""

    def __init__(self, reference: Grey, settings: CorrelationSettings, files: SeriesFiles) -> None:
        self._reference, self._settings, self._files = reference, settings, files
        self._writer = None if files.output is None else ResultWriter(files.output)

    def __enter__(self) -> Self:
        if self._writer is not None:
            self._writer.__enter__()
        return self

    def __exit__(self, *error: Any) -> None:
        if self._writer is not None:
            self._writer.__exit__(*error)

    def write(self, number: int, measurement: Measurement) -> None:
        """Write the measurement of the image `number` to every requested file."""
        if self._writer is not None:
            self._writer.add("series", measurement)
        if self._files.csv:
            write_csv(measurement, self._files.csv[number])
        if self._files.maps:
            name = Path(measurement.label).name
            title = f"{name}, subset {self._settings.subset_px} px, step {self._settings.step_px} px"
            write_maps(measurement, self._reference, self._files.maps[number], title=title)

    def write_corrections(self, corrections: Sequence[Correction]) -> None:
        """Write the corrections of the images when all are known."""
        if self._writer is not None and corrections:
            self._writer.add_corrections("series", corrections)
