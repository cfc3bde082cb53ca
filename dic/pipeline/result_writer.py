"""Writes the result file of a measurement: of a run's cameras, or of a series of image files.

The results of a run are in one group for each camera, those of a series of image files in the group `series`.
`docs/results.md` describes the layout.
"""

from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from functools import partial
from itertools import count
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from dic.calibration.file import write_calibration
from dic.correlation.series_state import SeriesFields
from dic.errors import require_kind
from dic.image.threads import bands_of
from dic.out_of_plane.alignment import Alignment
from dic.pipeline.camera import CorrectedCamera
from dic.pipeline.corrections import MeasuredStep, RunCorrections
from dic.pipeline.measured_images import MeasuredImage
from dic.pipeline.result import CameraResult, RunResult, measured_steps
from dic.pipeline.set_up import RunSetUp, SetUp
from dic.results.alignment import write_alignment
from dic.results.fields import StoredFields
from dic.results.finished import FinishedImage
from dic.results.job import ImageOutcome
from dic.results.place import ResultPlace
from dic.results.provenance import Provenance
from dic.results.schema import JOINT, CameraLayout
from dic.results.steps import write_steps
from dic.results.writer import ResultWriter
from dic.runfile.reader import RunStep
from dic.strain.settings import StrainSettings
from dic.typing import PathLike

_ROWS = 512
"""Number of rows of the reference that are converted and written at a time, if chunks are not higher."""


class MeasurementWriter:
    """Writes the result file of a measurement image by image; use it in a `with` statement.

    `images_before`: as for `ResultWriter`.
    """

    def __init__(
        self,
        place: ResultPlace,
        cameras: Sequence[CorrectedCamera],
        set_up: SetUp,
        origin: Provenance,
        images_before: float = 0,
    ) -> None:
        self._writer = ResultWriter(place.path, origin, place.outputs, images_before)
        self._cameras, self._set_up = list(cameras), set_up
        self._stored: dict[str, StoredFields] = {}
        self._shared: dict[str, dict[str, Any]] = {}
        self._remarks = {camera.camera: camera.remarks for camera in cameras}
        self._failed: dict[str, list[ImageOutcome]] = {camera.camera: [] for camera in cameras}

    def __enter__(self) -> Self:
        self._writer.__enter__()
        try:
            for camera in self._cameras:
                layout = CameraLayout.of(camera.camera)
                _write_reference(self._writer.group(layout.place), camera.reference)
                if camera.calibration is not None:
                    write_calibration(self._writer.group(layout.calibration), camera.calibration)
            if isinstance(self._set_up, RunSetUp):
                self._write_run(self._set_up)
        except BaseException as error:
            self._writer.__exit__(type(error), error, error.__traceback__)
            raise
        return self

    def __exit__(self, *error: Any) -> None:
        self._writer.__exit__(*error)

    def add_field(self, camera: str, image: FinishedImage) -> None:
        """Append the outcome of the correlation of a camera's next image."""
        self._stored.pop(camera, None)
        if image.fields is None:
            self._failed[camera].append(image.outcome)
        elif camera not in self._shared:
            self._shared[camera] = {"region": image.field.region, "grid": image.field.grid}
        self._writer.add_field(CameraLayout.of(camera), image)

    def fields_of_row(self, camera: str, row: int) -> SeriesFields:
        """Return the fields of an image again, by its index among the images with fields."""
        return self._fields(camera).of_row(row)

    def finished_images(self, camera: str, outcomes: Sequence[ImageOutcome]) -> Sequence[FinishedImage]:
        """Return the images of a camera again; each is read when it is used."""
        if all(outcome.failure is not None for outcome in outcomes):
            return [FinishedImage(each.label, failure=each.failure, time=each.time) for each in outcomes]
        return self._fields(camera).images(outcomes)

    def commit_if_due(self) -> None:
        """Make sure that the file can be read as it is now, if much is new since the last time."""
        self._writer.commit(if_due=True)

    def add_step(self, step: MeasuredStep, pair: tuple[str, str] | None = None) -> None:
        """Append the strains and corrections of a step; `pair` names the cameras of its joint solution."""
        joint = step.joint
        for name, image in step.images.items():
            if image.measurement is not None:
                together = joint is not None and joint.declined is None and name in (pair or ())
                self._writer.add(
                    CameraLayout.of(name), image.measurement, image.correction, elsewhere=together
                )
        if joint is not None and pair is not None and step.step is not None:
            self._writer.add_two_cameras(JOINT, pair, step.step.index, joint)

    def finish(
        self,
        alignments: Mapping[str, Alignment | None],
        steps: Mapping[str, Sequence[RunStep]],
        corrections: RunCorrections | None = None,
        failures: Mapping[str, Sequence[str]] | None = None,
        *,
        whole: bool = True,
    ) -> None:
        """Write what is known only after the last step.

        `alignments`: the alignment of each camera, if the images of a rotation have solved it. `steps`: the
        steps of a run that each camera has measured. `corrections`: the corrections of a run, with the
        findings on its set-up. `failures`: one sentence for each step of a run that a camera could not
        measure. Default: from the images. `whole`: False if the measurement was stopped before the last
        image.
        """
        for camera, alignment in alignments.items():
            group = self._writer.group(CameraLayout.of(camera).place)
            if alignment is not None:
                write_alignment(group, alignment)
            failed = [(each.label, each.failure or "") for each in self._failed[camera]]
            if corrections is None:
                for k, name in enumerate(("failed_label", "failure")):
                    _write_texts(group, name, [one[k] for one in failed])
            else:
                sentences = [f"{self._source()}: {camera}, {label}: {why}" for label, why in failed]
                group.attrs["failures"] = "\n".join(sentences if failures is None else failures[camera])
                write_steps(group, steps[camera], self._remarks[camera])
                _write_texts(group, "findings", corrections.findings[camera])
        if corrections is not None:
            # Also a run without any measured step has results: the reasons.
            self._writer.has_results = True
            self._writer.group("run").attrs["motion"] = corrections.motion
            if corrections.joint is not None:
                group = self._writer.group(JOINT)
                group.attrs["cameras"] = list(corrections.joint.cameras)
                _write_texts(group, "findings", corrections.joint.findings)
        if whole:
            self._writer.finish()

    def _write_run(self, set_up: RunSetUp) -> None:
        self._writer.group("run").attrs.update(
            {name: value for name, value in asdict(set_up.info).items() if value is not None}
            | {"source": set_up.source}
        )
        correcting = {"correcting": set_up.correcting.as_text()}
        self._writer.group("settings").attrs.update(vars(set_up.settings) | correcting)

    def _source(self) -> str:
        return self._set_up.source if isinstance(self._set_up, RunSetUp) else ""

    def _fields(self, camera: str) -> StoredFields:
        if camera not in self._stored:
            group = self._writer.stored(CameraLayout.of(camera))
            self._stored[camera] = StoredFields(group, self._shared[camera])
        return self._stored[camera]


def save_run_result(result: RunResult, path: PathLike) -> None:
    """Write the result file of a run. `docs/results.md` describes the layout of the file.

    Raises
    ------
    RunFileError
        If the file cannot be created.
    """
    require_kind("result", result, RunResult, "process a run first: dic.process_run(path)")
    corrections, origin = result.corrections, result.provenance or Provenance.of([])
    strain = StrainSettings()  # the file takes the settings of strain from the measurements
    set_up = RunSetUp(result.source, result.info, result.settings, strain, result.correcting, 0.0)
    pair = None if corrections.joint is None else corrections.joint.cameras
    with MeasurementWriter(ResultPlace(Path(path)), result.cameras, set_up, origin) as writer:
        for camera in result.cameras:
            deque(map(partial(writer.add_field, camera.camera), _finished_images(camera)), maxlen=0)
        deque(map(partial(writer.add_step, pair=pair), steps_of(result)), maxlen=0)
        steps = {camera.camera: camera.steps for camera in result.cameras}
        alignments = {name: corrections.cameras[name].alignment for name in steps}
        failures = {camera.camera: camera.failures for camera in result.cameras}
        writer.finish(alignments, steps, corrections, failures)


def _finished_images(camera: CameraResult) -> Iterator[FinishedImage]:
    """Yield the images of a camera; those of a result that was not read from a file are its measurements."""
    rows = count()
    outcomes = camera.outcomes or [ImageOutcome(f"step {step.index}", "") for step in camera.steps]

    def image(outcome: ImageOutcome) -> FinishedImage:
        if outcome.failure is not None:
            return FinishedImage(outcome.label, failure=outcome.failure, content=outcome.content)
        measurement = camera.measurements[next(rows)]
        fields = SeriesFields(measurement.field)
        return FinishedImage(measurement.label, measurement.digest, fields, content=outcome.content)

    return map(image, outcomes)


def steps_of(result: RunResult) -> Iterator[MeasuredStep]:
    """Yield the steps of a run whose strains are corrected already."""

    def made(number: int, step: RunStep, places: Mapping[str, int]) -> MeasuredStep:
        images = {}
        for camera in result.cameras:
            if camera.camera in places:
                place = places[camera.camera]
                measurement = camera.measurements[place]
                own = result.corrections.cameras[camera.camera].images[place]
                images[camera.camera] = MeasuredImage(measurement.label, measurement, own)
        joint = None if result.corrections.joint is None else result.corrections.joint.steps.get(step.index)
        return MeasuredStep(number, step, images, {}, joint)

    return (made(number, *each) for number, each in enumerate(measured_steps(result.cameras)))


def _write_reference(group: Any, reference: NDArray[Any]) -> None:
    stored = group.create_dataset(
        "reference", reference.shape, np.float32, shuffle=True, compression="gzip", compression_opts=1
    )
    # Convert some rows at a time. Each write fills whole chunks, because a chunk is compressed as a whole.
    chunk = stored.chunks[0]
    for rows in bands_of(len(reference), chunk * max(1, _ROWS // chunk)):
        stored[rows] = reference[rows].astype(np.float32)
    stored.attrs["units"] = "grey level"


def _write_texts(group: Any, name: str, texts: Sequence[str]) -> None:
    import h5py

    group.create_dataset(name, data=list(texts), dtype=h5py.string_dtype())
