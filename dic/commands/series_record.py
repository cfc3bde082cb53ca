"""The record of a series of images: `dic correlate` prints each result and keeps it for the output files."""

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

from dic.commands.series_text import corrected_lines, image_lines, name_of, series_table
from dic.shell.console import fail, say

if TYPE_CHECKING:
    from dic import Alignment, Calibration, Correction, MeasuredImage, Motion


class SeriesRecord:
    """Print the result of each measured image, and keep the values for the output files.

    Parameters
    ----------
    labels : sequence of str
        Labels of all images of the series.
    calibrated : bool
        True if there is a calibration.
    keep_corrections : bool
        True to keep the corrections for a result file. Corrections take much memory.

    Attributes
    ----------
    summaries : list of dict
        Summaries of the measured images, as dictionaries for JSON.
    failures : list of dict
        Images that could not be measured. Each dictionary has the keys `file` and `error`.
    bad : list of str
        One sentence for each image that was measured poorly.
    rows : list of dict
        The summaries and failures of all images in order, for the table of strains.
    corrections : list of Correction
        Corrections of the measured images, if `keep_corrections` is true.
    """

    def __init__(self, labels: Sequence[str], *, calibrated: bool, keep_corrections: bool) -> None:
        self._table = series_table([name_of(label) for label in labels], only_raw=not calibrated)
        self._headed = False
        self._keep_corrections = keep_corrections
        self.summaries: list[dict[str, Any]] = []
        self.failures: list[dict[str, str]] = []
        self.bad: list[str] = []
        self._rows: list[tuple[dict[str, Any], str | None]] = []
        self.corrections: list[Correction] = []
        self._waiting: list[MeasuredImage] = []

    @property
    def rows(self) -> list[dict[str, Any]]:
        """The results of all images for `dic.write_strain_table`, with the problem of each image or None."""
        return [row | {"error": problem} for row, problem in self._rows]

    def add(self, image: "MeasuredImage", *, rotation: bool) -> None:
        """Add a measured image to the record, and print its result.

        If the motion is a rotation, keep the image, because the correction of a rotation needs all images.
        """
        measurement = image.measurement
        if measurement is None:
            self.fail(image.label, f"{image.failure}")
            return
        summary = measurement.summary() | {"good": measurement.good}
        if image.correction is not None:
            self._correct(summary, image.correction)
        if rotation:
            self._waiting.append(image)
        self.summaries.append(summary)
        self._rows.append((summary, measurement.objection))
        self._say(image_lines(self._table, summary, first=len(self.summaries) == 1))
        if measurement.objection is not None:
            self.bad.append(f"{image.label}: measured, but {measurement.objection}")

    def fail(self, label: str, error: str, consequence: str = "") -> None:
        """Add an image that could not be measured to the record, and print the reason."""
        failure = {"file": label, "error": error}
        self.failures.append(failure)
        self._rows.append((failure, error))
        fail((error if label in error else f"{label}: {error}") + consequence)

    def finish(
        self,
        calibration: "Calibration | None",
        motion: "Motion",
        rewrite: "Callable[[int, MeasuredImage], None]",
    ) -> "Alignment | None":
        """Correct the images of a rotating specimen, and return the alignment of the rotation stage.

        If the motion is not a rotation, no image is corrected here, and the result is the given alignment or
        None. The function `rewrite` gets the index of each corrected image among the measured images, and the
        image with its correction and with the errors of calibrated strain that the correction found.
        """
        from dic import corrected_rotation

        if calibration is None or not self._waiting:
            return motion.alignment
        images, alignment = corrected_rotation(self._waiting, calibration, motion)
        self._headed = False
        for place, (summary, image) in enumerate(zip(self.summaries, images, strict=True)):
            if image.correction is not None and image.measurement is not None:
                rewrite(place, image)
                summary["calibrated"] = image.measurement.summary()["calibrated"]
                self._correct(summary, image.correction)
                self._say(corrected_lines(self._table, summary))
        return alignment

    def _say(self, lines: Sequence[str]) -> None:
        """Print lines of the table, at first below its heading."""
        for line in lines if self._headed else [self._table.heading(), *lines]:
            say(line)
        self._headed = True

    def _correct(self, summary: dict[str, Any], correction: "Correction") -> None:
        summary["corrected"] = correction.as_dict()
        if self._keep_corrections:
            self.corrections.append(correction)
