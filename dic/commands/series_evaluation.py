"""Compute, print and write the strains of a series whose images are correlated one by one."""

from __future__ import annotations

import json
from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click

import dic
from dic.commands.gauge_text import gauge_lines, gauges_dict
from dic.commands.series_record import SeriesRecord
from dic.files import write_text
from dic.shell.console import fail, say, stopped_early, stopping_between
from dic.shell.progress import progress

_UNCORRECTED = (
    "the ± of calibrated strain contains a possible motion out of the grid's plane; --motion corrects for it"
)


@dataclass(frozen=True)
class SeriesPlaces:
    """The paths and the formats of a series' output files."""

    files: dic.derived.SeriesFiles
    drawn: dic.pictures.MapSettings
    """Settings of the maps and contact sheets among `files`."""
    decimal_comma: bool


class SeriesEvaluation:
    """The strains of a series: printed, written to the output files, and recorded."""

    def __init__(
        self,
        reference: dic.typing.Grey,
        labels: Sequence[str],
        settings: dic.CorrelationSettings,
        set_up: dic.pipeline.SeriesSetUp,
        places: SeriesPlaces,
    ) -> None:
        self._reference, self._labels = reference, labels
        self._settings, self._set_up, self._places = settings, set_up, places
        self.record = SeriesRecord(labels, calibrated=set_up.calibration is not None)
        self.alignment: dic.out_of_plane.Alignment | None = None
        """The rotation stage's alignment, after the last image."""
        self._maps: dic.derived.SeriesMaps | None = None
        self._gauges: dict[str, Any] = {}

    def measure(self, measuring: dic.pipeline.Measuring, doing: str = "correlating") -> bool:
        """Measure the images; return True after the last one, and False if a signal stopped the series.

        `doing`: text of the progress bar.
        """
        count = len(self._labels)
        with self._outputs() as results, progress(doing, count) as bar, stopping_between() as stopped:
            shown = 0

            def show(step: dic.pipeline.MeasuredStep) -> None:
                nonlocal shown
                number, image = step.number, step.image
                if not step.provisional:
                    results.write(number, image)
                if number < shown:
                    self.record.correct(number, image)
                    return
                self.record.add(number, image)
                bar.advance()
                shown += 1
                left = count - number - 1
                if stopped() and left:
                    rest = stopped_early(left, count, "measured")
                    self.record.fail(number + 1, self._labels[number + 1], rest, "; those before it are kept")
                    measuring.stopped = True

            deque(map(show, measuring.steps()), maxlen=0)
        self.alignment = measuring.alignment("")
        return not measuring.stopped

    def show(self, series: dic.pipeline.MeasuredSeries) -> bool:
        """Print the results of images that are measured, and write all files except the result file."""
        with self._outputs() as results:
            for number, image in enumerate(series.images):
                results.write(number, image)
                self.record.add(number, image)
        self.alignment = series.alignment
        return True

    @contextmanager
    def _outputs(self) -> Iterator[dic.derived.SeriesOutputs]:
        """Print what all images share, and provide the output files; write the table of strains last."""
        files, calibration, motion = self._places.files, self._set_up.calibration, self._set_up.motion
        say(self._gauge())
        if calibration is not None and motion is not None and motion.kind == "free":
            say(_UNCORRECTED)
        if calibration is not None and motion is not None and motion.still is not None:
            say(motion.still.text(calibration.mm_per_px))
        self._maps = maps = dic.derived.SeriesMaps(self._reference, files.pictures, self._places.drawn)
        gauges = (
            dic.derived.GaugeReader(files.gauges, calibration, self._reference.shape)
            if files.gauges
            else None
        )
        comma = self._places.decimal_comma
        results = dic.derived.SeriesOutputs(self._settings, files, maps, gauges, decimal_comma=comma)
        try:
            yield results
        finally:
            results.write_table(list(self.record.rows))
        if files.gauges:
            for line in gauge_lines(results.gauge_series):
                say(line)
            self._gauges = gauges_dict(results.gauge_series)

    def write_json(self, path: Path, reference: str, specimen: dic.specimen.Specimen | None) -> None:
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
        if self._maps is not None and self._maps.pictures_left:
            with progress("drawing", self._maps.pictures_left) as bar:
                self._maps.draw(bar.advance)

    def _gauge(self) -> str:
        """Return lines about the virtual strain gauge: its width, and the strain wave that it resolves."""
        settings, strain, calibration = self._settings, self._set_up.strain, self._set_up.calibration
        gauge_px, resolved_px = strain.gauge_px(settings), dic.strain.strain_resolution_px(settings, strain)
        gauge = dic.strain.gauge_text(gauge_px, None if calibration is None else calibration.axes_mm_per_px)
        wave = f"a strain wave with a period of {resolved_px:.0f} px"
        return f"{gauge}\n  keeps 90 % of the amplitude of {wave}"

    def _calibrated(self) -> dict[str, Any]:
        """Return assumed motion, the stage's alignment and the camera's sensitivity, for JSON."""
        calibration, motion = self._set_up.calibration, self._set_up.motion
        if calibration is None or motion is None:
            return {}
        sensitivity = dic.out_of_plane.Sensitivity.of(calibration)
        return {
            "motion": motion.kind,
            "shift": motion.shift.as_dict(),
            "still": None if motion.still is None else motion.still.as_dict(),
            "alignment": None if self.alignment is None else self.alignment.as_dict(),
            "sensitivity": None if sensitivity is None else vars(sensitivity),
        }


def end(record: SeriesRecord) -> None:
    """Print the problems of the images, and end the command with its exit status."""
    for sentence in record.bad:
        fail(sentence)
    click.get_current_context().exit(2 if record.failures else 1 if record.bad else 0)
