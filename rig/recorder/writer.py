"""The thread that writes the run file: it takes jobs from a queue and writes them in batches."""

import threading
from collections import Counter, deque
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from dataclasses import dataclass, field

from drivers.clock import Clock
from rig.recorder.file import ROW_BYTES, OpenRunFile
from rig.recorder.place import Misplaced, Overwritten
from rig.recording import RecordingSettings

_JOBS_MAX = 100_000
_BATCH = 8
GATHER_S = 0.05
"""A row waits at most this time in s for others, because writing eight rows at once is six times as fast."""


@dataclass
class WriteJob:
    """One piece of data that is written into the run file, such as an image or a step."""

    what: str  # description of the job, for error messages
    write: Callable[[OpenRunFile], None]  # function that writes the data to the file
    camera: str | None = None  # the camera whose image is written
    size: int = 0  # size in bytes of an image or of many samples; 0 for one row
    wait_for_disk: bool = False  # True if the job is done only after the file was synchronised with the disk
    # future that is done when the data were written, or with an exception if writing failed
    done: "Future[None]" = field(default_factory=Future)

    @property
    def urgent(self) -> bool:
        """True for an image, which occupies memory, and for a job that the engine waits for."""
        return self.wait_for_disk or self.camera is not None


class Writer(threading.Thread):
    """Thread that writes jobs in the order of their arrival, until a job fails or the last job is done.

    Only this thread uses the file after `start`. `clock` is in real time, also for a simulated run, because
    the disk is real. `failed` makes the error for a failed job, from the job's description and the exception.
    `gather_s` is the longest real time in s for which a reading or an event waits, in order to be written
    with other rows.
    """

    def __init__(
        self,
        file: OpenRunFile,
        settings: RecordingSettings,
        clock: Clock,
        failed: Callable[[str, BaseException], Exception],
        gather_s: float = GATHER_S,
    ) -> None:
        super().__init__(name="recorder", daemon=True)
        self._file, self._settings, self._clock, self._failed = file, settings, clock, failed
        self._gather_s = gather_s
        self._jobs: deque[WriteJob] = deque()
        self._changed = threading.Condition()
        self._waiting: Counter[str] = Counter()
        self._last: Callable[[], None] | None = None
        self._ended: Future[None] = Future()
        self._images = 0
        self._unsynchronised_s: float | None = None  # the time of the first write after a synchronisation
        self._began_s: float | None = None
        self.failure: Exception | None = None

    def put(self, job: WriteJob) -> bool:
        """Append a job and return at once. Return False if too many jobs or images of this camera wait."""
        with self._changed:
            full = len(self._jobs) >= _JOBS_MAX
            if full or (job.camera and self._waiting[job.camera] >= self._settings.queue_frames):
                return False
            if job.camera:
                self._waiting[job.camera] += 1
            self._jobs.append(job)
            if job.urgent or len(self._jobs) == 1 or len(self._jobs) >= _BATCH:
                self._changed.notify_all()
            return True

    def wait_for_room(self, camera: str, timeout_s: float) -> bool:
        """Wait until the queue has room for an image of `camera`. Return False after `timeout_s` seconds."""
        with self._changed:
            return self._changed.wait_for(
                lambda: self._waiting[camera] < self._settings.queue_frames or self.failure is not None,
                timeout_s,
            )

    def end(self, last: Callable[[], None]) -> "Future[None]":
        """Let the thread write the waiting jobs, call `last` even if a job has failed, and end."""
        with self._changed:
            self._last = last
            self._changed.notify_all()
        return self._ended

    def busy_s(self) -> float:
        """Return the time in s since the writing of the present jobs began."""
        began_s = self._began_s
        return 0.0 if began_s is None else self._clock.now_s() - began_s

    def run(self) -> None:
        """Write jobs until `end` is called. This method runs on the thread."""
        while jobs := self._next_jobs():
            self._began_s = self._clock.now_s()
            if self.failure is None:
                self._write(jobs)
            self._began_s = None
            self._forget(jobs)
        assert self._last is not None
        try:
            self._last()
        except BaseException as error:
            self._ended.set_exception(error)
        else:
            self._ended.set_result(None)

    def _next_jobs(self) -> list[WriteJob]:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._jobs or self._last is not None, self._patience_s())
                if self._jobs:
                    self._changed.wait_for(self._has_batch, self._gather_s)
                    return [self._jobs.popleft() for _ in range(min(_BATCH, len(self._jobs)))]
                if self._last is not None:
                    return []
            self._synchronise_quietly()

    def _has_batch(self) -> bool:
        """Return whether the waiting jobs should be written now."""
        full = len(self._jobs) >= _BATCH or self._last is not None
        return full or any(job.urgent for job in self._jobs)

    def _patience_s(self) -> float | None:
        if self._unsynchronised_s is None or self.failure is not None:
            return None
        return max(0.0, self._unsynchronised_s + self._settings.sync_s - self._clock.now_s())

    def _write(self, jobs: list[WriteJob]) -> None:
        written: list[WriteJob] = []
        doing = jobs[0]
        try:
            self._file.require_untouched()
            for doing in self._affordable(jobs):
                doing.write(self._file)
                written.append(doing)
            self._file.commit()
            self._synchronise_if_due(written)
        except Exception as error:
            self._fail(doing.what, error)
            if isinstance(error, Overwritten):
                self._file.leave()
            elif not isinstance(error, Misplaced):
                self._file.abandon()
            return
        for job in written:
            job.done.set_result(None)

    def _affordable(self, jobs: list[WriteJob]) -> Iterator[WriteJob]:
        """Reserve disk space for one job after the other, and yield each of them. End at a full disk."""
        collected = 0  # images are written at once, but samples stay in memory until `commit`
        for job in jobs:
            try:
                self._file.require_space(collected + job.size + ROW_BYTES)
            except OSError as error:
                self._fail(job.what, error)
                return
            yield job
            collected += 0 if job.camera else job.size

    def _synchronise_if_due(self, written: list[WriteJob]) -> None:
        # Count from the first write and not from the last synchronisation. Otherwise the first image after a
        # pause would be synchronised at once, and its step and the images of other cameras would wait for it.
        if self._unsynchronised_s is None:
            self._unsynchronised_s = self._began_s or 0.0
        self._images += sum(job.camera is not None for job in written)
        late = self._clock.now_s() - self._unsynchronised_s >= self._settings.sync_s
        if late or self._images >= self._settings.sync_frames or any(job.wait_for_disk for job in written):
            self._synchronise()

    def _synchronise(self) -> None:
        self._file.synchronise()
        self._images, self._unsynchronised_s = 0, None

    def _synchronise_quietly(self) -> None:
        try:
            self._synchronise()
        except OSError as error:
            self._fail("synchronising the run file with the disk", error)
            if isinstance(error, Overwritten):
                self._file.leave()

    def _fail(self, what: str, error: BaseException) -> None:
        with self._changed:
            if self.failure is None:
                self.failure = self._failed(what, error)
            self._changed.notify_all()

    def _forget(self, jobs: list[WriteJob]) -> None:
        """Remove jobs from the queue. The futures of jobs that were not written get an exception."""
        with self._changed:
            for job in jobs:
                if job.camera:
                    self._waiting[job.camera] -= 1
            self._changed.notify_all()
        for job in jobs:
            if not job.done.done():
                job.done.set_exception(self.failure or RuntimeError(job.what))
