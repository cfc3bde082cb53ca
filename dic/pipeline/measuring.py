"""The measurement of one or several cameras: correlate each image, keep it, compute its strain, correct it.

Images may come one by one. Each image is kept in the result file as soon as it is correlated; its strain is
computed at once, or after the last image. The corrections of a rotation are computed after the last image,
because they need all images.
"""

from collections import deque
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import partial
from itertools import count
from typing import Any

from dic.files.lazy import Computed
from dic.image.memory import give_back_memory
from dic.image.stored import is_large
from dic.image.threads import one_ahead
from dic.out_of_plane.alignment import Alignment
from dic.pipeline.camera import CameraImages, Kept
from dic.pipeline.corrections import Corrector, MeasuredStep, need_all_images
from dic.pipeline.measured import measurement_of
from dic.pipeline.measured_images import MeasuredImage
from dic.pipeline.result_writer import MeasurementWriter
from dic.pipeline.set_up import RunSetUp, SetUp
from dic.results.finished import FinishedImage
from dic.results.job import ImageOutcome
from dic.results.place import ResultPlace
from dic.results.provenance import Provenance
from dic.runfile.reader import RunStep
from dic.strain.measurement import Measurement


@contextmanager
def measuring_into(
    place: ResultPlace | None,
    cameras: Sequence[CameraImages],
    set_up: SetUp,
    origin: Provenance,
    images_before: float = 0,
    **how: Any,
) -> "Iterator[Measuring]":
    """Provide a measurement that writes a result file, or none.

    `cameras`, `set_up`: as for `Measuring`. `origin`, `images_before`: as for `MeasurementWriter`. `**how`:
    further arguments of `Measuring`.
    """
    if place is None:
        yield Measuring(cameras, set_up, **how)
        return
    with MeasurementWriter(place, cameras, set_up, origin, images_before) as writer:
        yield Measuring(cameras, set_up, writer, **how)


class Measuring:
    """The measurement of one or several cameras.

    Parameters
    ----------
    cameras : sequence of CameraImages
        Cameras that recorded the same steps.
    set_up : SetUp
    writer : MeasurementWriter, optional
        Writes the result file. Without a writer, the finished images stay in memory if they are needed again.
    at_once : bool
        True to compute the strain of an image as soon as it is correlated, so that the caller can use it.
        Otherwise the strains are computed after the last image, when the memory that the correlation needed
        is free.
    provisional : bool
        True to yield each image of a rotation also at once, without its correction.
    on_image : callable, optional
        Function that is called after each correlated image of each camera.

    Attributes
    ----------
    stopped : bool
        The caller sets this to True to end the measurement after the current image.
    outcomes : dict of str to list of ImageOutcome
        The outcomes of each camera's images so far.
    """

    def __init__(
        self,
        cameras: Sequence[CameraImages],
        set_up: SetUp,
        writer: MeasurementWriter | None = None,
        *,
        at_once: bool = True,
        provisional: bool = False,
        on_image: Callable[[], None] = lambda: None,
    ) -> None:
        self._cameras, self._set_up, self._writer = list(cameras), set_up, writer
        self._at_once, self._provisional, self._on_image = at_once, provisional, on_image
        self._large = any(is_large(camera.reference.shape) for camera in cameras)
        self._outlines: list[MeasuredStep] = []
        self._in_memory: dict[str, list[FinishedImage]] = {camera.camera: [] for camera in cameras}
        self._corrector = Corrector({}, {})
        self.stopped = False
        self.outcomes: dict[str, list[ImageOutcome]] = {camera.camera: [] for camera in cameras}

    def steps(self) -> Iterator[MeasuredStep]:
        """Yield the steps, or the images of a series, in their order.

        A caller that calls a function for each step, and keeps none, needs the memory of one step only.
        """
        planned = {camera.camera: camera.steps for camera in self._cameras}
        of_all = need_all_images(self._set_up.motions(planned))
        if of_all and not self._provisional:
            self._at_once = False
        if self._at_once:
            self._new_corrector(planned)
            known, correlated = all(camera.known for camera in self._cameras), self._correlated()
            # Two steps of large images, or a step and a correlation, would need too much memory. Images of a
            # series may come one by one, and its caller may stop it after any of them.
            if not (known or self._large) and any(planned.values()):
                correlated = one_ahead(correlated)
            steps = map(self._evaluated, count(), correlated)
            yield from map(self._written, one_ahead(steps) if known and not self._large else steps)
        else:
            # Run through all images, and keep none.
            deque(self._correlated(), maxlen=0)
            give_back_memory()
            self._new_corrector(self._measured_steps())
        if of_all or not self._at_once:
            yield from map(self._written, self._remaining())
        self._finish()

    def alignment(self, camera: str) -> Alignment | None:
        """Return the alignment of a rotation, after the last step."""
        return self._corrector.alignment(camera)

    def _new_corrector(self, steps: Mapping[str, Sequence[RunStep]]) -> None:
        motions, reference_s = self._set_up.motions(steps), self._set_up.reference_s
        self._corrector = Corrector.of(self._cameras, motions, reference_s)

    def _correlated(self) -> Iterator[dict[str, FinishedImage]]:
        """Yield the finished image of each camera at each step; the cameras work at the same time."""
        images = {camera.camera: camera.images(self._kept(camera.camera)) for camera in self._cameras}
        try:
            with ThreadPoolExecutor(len(images)) as pool:
                of_all = pool.map if len(images) > 1 else map

                def step() -> dict[str, FinishedImage]:
                    if self.stopped:
                        return {}
                    every = zip(images, of_all(self._next, images, images.values()), strict=True)
                    return {name: image for name, image in every if image is not None}

                yield from iter(step, {})
        finally:
            for each in images.values():
                if isinstance(each, Generator):
                    each.close()

    def _next(self, camera: str, images: Iterator[FinishedImage]) -> FinishedImage | None:
        """Return the next image of a camera, which is kept; None after the last one."""
        found = next(images, None)
        if found is None:
            return None
        self.outcomes[camera].append(found.outcome)
        if self._writer is not None:
            self._writer.add_field(camera, found)
            if not self._at_once:
                self._writer.commit_if_due()
        elif self._provisional or not self._at_once:
            self._in_memory[camera].append(found)
        self._on_image()
        return found if self._at_once else FinishedImage(found.label)

    def _kept(self, camera: str) -> Kept | None:
        """Return the function that reads the fields of an image again; None if they are not in a file."""
        writer = self._writer
        return None if writer is None else partial(writer.fields_of_row, camera)

    def _evaluated(self, number: int, found: Mapping[str, FinishedImage]) -> MeasuredStep:
        """Return the measured step of images that have just been correlated."""
        images = {camera.camera: self._image(camera, found[camera.camera]) for camera in self._cameras}
        return self._corrected(number, images, {})

    def _corrected(
        self, number: int, images: Mapping[str, MeasuredImage], places: Mapping[str, int]
    ) -> MeasuredStep:
        steps = self._cameras[0].steps
        step = self._corrector.corrected(number, steps[number] if steps else None, images, places)
        return step if self._writer is None or step.provisional else step.evaluated()

    def _remaining(self) -> Iterator[MeasuredStep]:
        """Yield the steps whose strains or corrections could not be computed at once."""
        finished = {camera.camera: self._finished(camera.camera) for camera in self._cameras}
        places: dict[str, dict[int, int]] = {}
        for camera in self._cameras:
            outcomes, images = self.outcomes[camera.camera], finished[camera.camera]
            own = [k for k, outcome in enumerate(outcomes) if outcome.failure is None]
            places[camera.camera] = {k: place for place, k in enumerate(own)}
            every = Computed(len(own), partial(self._measurement, camera, images, own))
            self._corrector.solve(camera.camera, every)

        def step(number: int) -> MeasuredStep:
            if self._large:
                # Free most of the memory of the step before.
                give_back_memory()
            images = {c.camera: self._image(c, finished[c.camera][number]) for c in self._cameras}
            places_of = {name: own[number] for name, own in places.items() if number in own}
            return self._corrected(number, images, places_of)

        steps = map(step, range(len(next(iter(self.outcomes.values())))))
        return steps if self._large else one_ahead(steps)

    def _written(self, step: MeasuredStep) -> MeasuredStep:
        if self._writer is not None:
            if not step.provisional:
                self._writer.add_step(step, self._corrector.pair)
                if step.step is not None:
                    self._outlines.append(step.outline)
            self._writer.commit_if_due()
        return step

    def _finish(self) -> None:
        if self._writer is not None:
            alignments = {name: self._corrector.alignment(name) for name in self.outcomes}
            of_run = isinstance(self._set_up, RunSetUp)
            corrections = self._corrector.corrections(self._outlines) if of_run else None
            if corrections is not None:
                alignments = {name: own.alignment for name, own in corrections.cameras.items()}
            whole = not self.stopped
            self._writer.finish(alignments, self._measured_steps(), corrections, whole=whole)

    def _finished(self, camera: str) -> Sequence[FinishedImage]:
        if self._writer is None:
            return self._in_memory[camera]
        return self._writer.finished_images(camera, self.outcomes[camera])

    def _image(self, camera: CameraImages, found: FinishedImage) -> MeasuredImage:
        if found.fields is None:
            return MeasuredImage(found.label, failure=found.failure, time=found.time)
        measurement = measurement_of(found, camera.calibration, self._set_up.strain)
        return MeasuredImage(found.label, measurement, time=found.time)

    def _measurement(
        self, camera: CameraImages, images: Sequence[FinishedImage], own: Sequence[int], place: int
    ) -> Measurement:
        return measurement_of(images[own[place]], camera.calibration, self._set_up.strain)

    def _measured_steps(self) -> dict[str, list[RunStep]]:
        """Return the steps that each camera has measured."""
        return {
            camera.camera: [
                step
                for step, outcome in zip(camera.steps, self.outcomes[camera.camera], strict=False)
                if outcome.failure is None
            ]
            for camera in self._cameras
        }
