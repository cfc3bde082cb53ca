"""The record of a series of images: `dic correlate` prints each result and keeps it for the output files."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import dic
from dic.commands.series_text import corrected_lines, image_lines, name_of, series_table
from dic.files import Spool
from dic.shell.console import fail, say


class SeriesRecord:
    """Print the result of each measured image, and keep the values for the output files."""

    def __init__(self, labels: Sequence[str], *, calibrated: bool) -> None:
        self._table = series_table([name_of(label) for label in labels], only_raw=not calibrated)
        self._headed = False
        self.rows: Spool[dict[str, Any]] = Spool()
        """The summaries and failures of all images by their index in the series, in a temporary file.

        A failure has the keys `file` and `error`; in a summary, `error` is None, or a sentence about a poor
        measurement.
        """
        self.measured: list[int] = []
        """Indices of the images that could be measured."""
        self.failures: list[dict[str, str]] = []
        """The failures of the images that could not be measured, as in `rows`."""
        self.bad: list[str] = []
        """One sentence for each image that was measured poorly."""

    def add(self, number: int, image: dic.pipeline.MeasuredImage) -> None:
        """Print the result of the image with the index `number`, and add it to the record."""
        measurement = image.measurement
        if measurement is None:
            self.fail(number, image.label, f"{image.failure}")
            self.rows.put(number, image.row())
            return
        self.measured.append(number)
        summary = image.row()
        self.rows.put(number, summary | {"good": measurement.good})
        self._say(image_lines(self._table, summary, first=len(self.measured) == 1))
        if measurement.objection is not None:
            self.bad.append(f"{image.label}: measured, but {measurement.objection}")

    def correct(self, number: int, image: dic.pipeline.MeasuredImage) -> None:
        """Print and record the correction of an image of a rotation, known only after the last image."""
        if image.measurement is None or image.correction is None:
            return
        self._headed = self._headed and number != self.measured[0]
        summary = image.row()
        self.rows.put(number, summary | {"good": image.measurement.good})
        self._say(corrected_lines(self._table, summary))

    def fail(self, number: int, label: str, error: str, consequence: str = "") -> None:
        """Add an image that could not be measured to the record, and print the reason."""
        failure = {"file": label, "error": error}
        self.failures.append(failure)
        self.rows.put(number, failure)
        fail((error if label in error else f"{label}: {error}") + consequence)

    def summaries(self) -> list[dict[str, Any]]:
        """Return the summaries of the measured images for JSON."""
        kept = (row for row in self.rows if "good" in row)
        return [{name: value for name, value in row.items() if name != "error"} for row in kept]

    def _say(self, lines: Sequence[str]) -> None:
        """Print lines of the table; the first call also prints the heading."""
        for line in lines if self._headed else [self._table.heading(), *lines]:
            say(line)
        self._headed = True
