"""The record of a series of images: `dic correlate` prints each result and keeps it for the output files."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from dic.commands.series_text import corrected_text, image_text
from dic.shell.console import fail, say

if TYPE_CHECKING:
    from dic import Alignment, Calibration, Correction, MeasuredImage, Motion


class SeriesRecord:
    """Print the result of each measured image, and keep the values for the output files.

    Parameters
    ----------
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
    corrections : list of Correction
        Corrections of the measured images, if `keep_corrections` is true.
    """

    def __init__(self, *, keep_corrections: bool) -> None:
        self._keep_corrections = keep_corrections
        self.summaries: list[dict[str, Any]] = []
        self.failures: list[dict[str, str]] = []
        self.bad: list[str] = []
        self.corrections: list[Correction] = []
        self._waiting: list[MeasuredImage] = []

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
        say(image_text(summary))
        if measurement.objection is not None:
            self.bad.append(f"{image.label}: measured, but {measurement.objection}")

    def fail(self, label: str, error: str, consequence: str = "") -> None:
        """Add an image that could not be measured to the record, and print the reason."""
        self.failures.append({"file": label, "error": error})
        fail((error if label in error else f"{label}: {error}") + consequence)

    def finish(self, calibration: "Calibration | None", motion: "Motion") -> "Alignment | None":
        """Correct the images of a rotating specimen, and return the alignment of the rotation stage.

        If the motion is not a rotation, no image is corrected here, and the result is the given alignment or
        None.
        """
        from dic import corrected_rotation

        if calibration is None or not self._waiting:
            return motion.alignment
        images, alignment = corrected_rotation(self._waiting, calibration, motion)
        for summary, image in zip(self.summaries, images, strict=True):
            if image.correction is not None:
                self._correct(summary, image.correction)
                say(f"{Path(summary['file']).name}: {corrected_text(summary['corrected'])}")
        return alignment

    def _correct(self, summary: dict[str, Any], correction: "Correction") -> None:
        summary["corrected"] = correction.as_dict()
        if self._keep_corrections:
            self.corrections.append(correction)
