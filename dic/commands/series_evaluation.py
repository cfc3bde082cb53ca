"""Compute, print and write the strains of a series whose images are correlated one by one."""

import json
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from copy import copy
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dic.commands.series_record import SeriesRecord
from dic.files.lazy import Computed
from dic.files.writing import write_text

if TYPE_CHECKING:
    from dic import Alignment, CorrelationSettings, MapSettings, MeasuredImage, MeasuredSeries, Specimen
    from dic.pipeline.series_files import SeriesFiles, SeriesOutputs
    from dic.pipeline.series_maps import SeriesMaps
    from dic.pipeline.series_set_up import SeriesSetUp
    from dic.results.job import Outcome
    from dic.results.provenance import Provenance
    from dic.results.unfinished import FinishedImage
    from dic.typing import Grey

_UNCORRECTED = (
    "the ± of calibrated strain contains a possible motion out of the grid's plane; --motion corrects for it"
)


@dataclass(frozen=True)
class SeriesPlaces:
    """The paths and the formats of a series' output files.

    Attributes
    ----------
    files : SeriesFiles
    drawn : MapSettings
        Settings of the maps and contact sheets among `files`.
    decimal_comma : bool
    """

    files: "SeriesFiles"
    drawn: "MapSettings"
    decimal_comma: bool


class SeriesEvaluation:
    """The strains of a series: printed, written to the output files, and recorded.

    Parameters
    ----------
    reference : ndarray, shape (height, width)
    labels : sequence of str
        Names of all images.
    settings : CorrelationSettings
        Settings of the correlation.
    set_up : SeriesSetUp
    places : SeriesPlaces

    Attributes
    ----------
    record : SeriesRecord
    alignment : Alignment or None
        The rotation stage's alignment, after `run`.
    """

    def __init__(
        self,
        reference: "Grey",
        labels: Sequence[str],
        settings: "CorrelationSettings",
        set_up: "SeriesSetUp",
        places: SeriesPlaces,
    ) -> None:
        self._reference, self._labels = reference, labels
        self._settings, self._set_up, self._places = settings, set_up, places
        self.record = SeriesRecord(labels, calibrated=set_up.calibration is not None)
        self.alignment: Alignment | None = set_up.motion.alignment
        self._outcomes: list[Outcome] = []
        self._maps: SeriesMaps | None = None
        self._gauges: dict[str, Any] = {}

    def run(
        self,
        images: "Iterable[FinishedImage]",
        again: "Callable[[int], FinishedImage]",
        origin: "Provenance | None",
        doing: str = "correlating",
    ) -> bool:
        """Evaluate the images; return True after the last one, and False if a signal stopped the series.

        Parameters
        ----------
        images : iterable of FinishedImage
            The images, which are correlated or read when they are used.
        again : callable
            Function that returns an image for a second time, by its index. A rotation needs all images twice.
        origin : Provenance or None
            Origin of the results, which is written into the result file.
        doing : str
            Text of the progress bar.
        """
        calibration, motion = self._set_up.calibration, self._set_up.motion
        with self._outputs(self._places.files, origin) as results:
            whole = self._measure(images, results, doing)
            if calibration is not None and motion.kind == "rigid":
                self._correct(results, again)
            results.write_set_up(self._reference, calibration, self._outcomes, self.alignment)
        return whole

    def show(self, series: "MeasuredSeries") -> bool:
        """Print the results of images that are measured, and write all files except the result file."""
        files = copy(self._places.files)
        files.output = None
        with self._outputs(files, None) as results:
            for number, image in enumerate(series.images):
                results.write(number, image)
                self.record.add(number, image)
        self.alignment = series.alignment
        return True

    @contextmanager
    def _outputs(self, files: "SeriesFiles", origin: "Provenance | None") -> "Iterator[SeriesOutputs]":
        """Print the values that all images share, and open the output files; write the table of strains."""
        from dic.commands.gauge_text import gauge_lines, gauges_dict
        from dic.pipeline.series_files import SeriesOutputs
        from dic.pipeline.series_maps import SeriesMaps
        from dic.shell.console import say

        say(self._gauge())
        if self._set_up.calibration is not None and self._set_up.motion.kind == "free":
            say(_UNCORRECTED)
        self._maps = maps = SeriesMaps(self._reference, files.pictures, self._places.drawn)
        comma, calibration = self._places.decimal_comma, self._set_up.calibration
        with SeriesOutputs(self._settings, files, maps, origin, decimal_comma=comma) as results:
            results.read_gauges(calibration, self._reference.shape)
            try:
                yield results
            finally:
                results.write_table(list(self.record.rows))
        if files.gauges:
            for line in gauge_lines(results.gauge_series):
                say(line)
            self._gauges = gauges_dict(results.gauge_series)

    def write_json(self, path: Path, reference: str, specimen: "Specimen | None") -> None:
        """Write the results of all images as JSON, for other programs."""
        content: dict[str, Any] = {
            "reference": reference,
            "settings": vars(self._settings),
            "images": self.record.summaries(),
        }
        if specimen is not None:
            content["specimen"] = specimen.as_dict()
        content |= self._calibrated() | self._gauges | {"failures": self.record.failures}
        write_text(path, json.dumps(content, indent=1))

    def draw(self) -> None:
        """Draw the pictures that need the scale of the whole series, which is known after `run`."""
        from dic.shell.progress import progress

        if self._maps is not None and self._maps.pictures_left:
            with progress("drawing", self._maps.pictures_left) as bar:
                self._maps.draw(bar.advance)

    def _measured(self, found: "FinishedImage") -> "MeasuredImage":
        from dic.pipeline.images import measured

        return measured(found, self._set_up.calibration, self._set_up.strain, self._set_up.motion)

    def _measure(self, images: "Iterable[FinishedImage]", results: "SeriesOutputs", doing: str) -> bool:
        """Measure the images one by one; print and write each result at once."""
        from dic.shell.console import stopped_early, stopping_between
        from dic.shell.progress import progress

        count = len(self._labels)
        with progress(doing, count) as bar, stopping_between() as stopped:
            for found in images:
                number = len(self._outcomes)
                self._outcomes.append(found.outcome)
                image = self._measured(found)
                if self._set_up.motion.kind != "rigid":
                    results.write(number, image)
                self.record.add(number, image)
                # Free the memory of a large image's fields before the next image is correlated.
                del found, image
                bar.advance()
                left = count - number - 1
                if stopped() and left:
                    rest = stopped_early(left, count, "measured")
                    self.record.fail(number + 1, self._labels[number + 1], rest, "; those before it are kept")
                    return False
        return True

    def _correct(self, results: "SeriesOutputs", again: "Callable[[int], FinishedImage]") -> None:
        """Solve the stage's alignment from all images of a rotation; correct, print and write the images."""
        from dic import corrected_rotation

        set_up, numbers = self._set_up, self.record.measured
        if set_up.calibration is None or not numbers:
            return
        images = Computed(len(numbers), lambda place: self._measured(again(numbers[place])))
        corrected, self.alignment = corrected_rotation(images, set_up.calibration, set_up.motion)
        for number, image in zip(numbers, corrected, strict=True):
            results.write(number, image)
            self.record.correct(number, image)

    def _gauge(self) -> str:
        """Return lines about the virtual strain gauge: its width, and the strain wave that it resolves."""
        from dic import gauge_text, strain_resolution_px

        settings, strain, calibration = self._settings, self._set_up.strain, self._set_up.calibration
        gauge_px, resolved_px = strain.gauge_px(settings), strain_resolution_px(settings, strain)
        gauge = gauge_text(gauge_px, None if calibration is None else calibration.axes_mm_per_px)
        wave = f"a strain wave with a period of {resolved_px:.0f} px"
        return f"{gauge}\n  keeps 90 % of the amplitude of {wave}"

    def _calibrated(self) -> dict[str, Any]:
        """Return assumed motion, the stage's alignment and the camera's sensitivity, for JSON."""
        from dic import Sensitivity

        calibration, motion = self._set_up.calibration, self._set_up.motion
        if calibration is None:
            return {}
        sensitivity = Sensitivity.of(calibration)
        return {
            "motion": motion.kind,
            "shift": motion.shift.as_dict(),
            "alignment": None if self.alignment is None else self.alignment.as_dict(),
            "sensitivity": None if sensitivity is None else vars(sensitivity),
        }


def end(record: SeriesRecord) -> None:
    """Print the problems of the images, and end the command with its exit status."""
    import click

    from dic.shell.console import fail

    for sentence in record.bad:
        fail(sentence)
    click.get_current_context().exit(2 if record.failures else 1 if record.bad else 0)
