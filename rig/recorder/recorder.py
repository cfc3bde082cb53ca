"""Write the run file, which keeps every finished step even if the program is killed (docs/run-file.md)."""

import errno
from collections import Counter, defaultdict, deque
from collections.abc import Callable, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from datetime import datetime
from functools import partial
from itertools import count
from pathlib import Path
from threading import Lock
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dic.runfile import schema
from dic.runfile.digests import frame_digest
from drivers.clock import SystemClock
from drivers.interfaces import CameraInfo, DeviceInfo, Frame, InterlockState, LoadFrameState, StageState
from rig.errors import RecordingError
from rig.recorder.file import OpenRunFile
from rig.recorder.place import Misplaced, Overwritten
from rig.recorder.records import (
    NO_CHANNELS,
    NO_INTERLOCKS,
    ChannelsRecord,
    InterlockRecord,
    RunHeader,
    StepRecord,
)
from rig.recorder.writer import WriteJob, Writer
from rig.recording import RecordingSettings
from rig.samples import TimedSamples

_STAGE = ("angle_deg", "moving", "homed", "time_s")
_LOAD_FRAME = ("load_n", "displacement_mm", "moving", "at_target", "holding", "sample", "time_s")
_CLOSING_S = 60.0
_FULL = (errno.ENOSPC, errno.EFBIG, errno.EDQUOT)


class Recorder:
    """Writes one run file, on a thread of its own.

    Every method except `close` and `wait_for_room` returns at once. If the file cannot be written, the next
    call and the futures returned by `step` raise `RecordingError`. Pixels are written before the row that
    marks them as valid, and images before the step that they belong to.

    Parameters
    ----------
    path : str or Path
        The new run file. An existing file is never overwritten.
    header : RunHeader
    cameras : mapping of str to CameraInfo
        The identity and picture format of each camera, by the camera's name in the rig file.
    stage, load_frame : DeviceInfo or None
        The descriptions of the stage and the load frame, or None for a missing device.
    interlocks : mapping of str to InterlockRecord, optional
        The interlocks, by their names in the rig file.
    channels : mapping of str to ChannelsRecord, optional
        The channel devices, by their names in the rig file.
    settings : RecordingSettings, optional
    """

    def __init__(
        self,
        path: str | Path,
        header: RunHeader,
        cameras: Mapping[str, CameraInfo],
        *,
        stage: DeviceInfo | None = None,
        load_frame: DeviceInfo | None = None,
        interlocks: Mapping[str, InterlockRecord] = NO_INTERLOCKS,
        channels: Mapping[str, ChannelsRecord] = NO_CHANNELS,
        settings: RecordingSettings | None = None,
    ) -> None:
        self.path = Path(path)
        self._settings = settings or RecordingSettings()
        self._cameras = dict(cameras)
        devices = {"stage": stage, "load_frame": load_frame}
        self._devices = {name: info for name, info in devices.items() if info is not None}
        self._interlocks = frozenset(interlocks)
        self._channels = dict(channels)
        try:
            file = OpenRunFile(self.path, header, self._cameras, self._devices, interlocks, channels)
        except FileExistsError as error:
            raise run_file_exists(self.path) from error
        except (OSError, RuntimeError, ValueError) as error:
            raise self._error("creating the run file", error) from error
        self._writer = Writer(file, self._settings, SystemClock(), self._error)
        # Two threads compute digests, because one thread is slower than a fast disk.
        self._hashing = ThreadPoolExecutor(2, "digests of images")
        self._order = Lock()
        self._numbers = count()
        self._rows: Counter[str] = Counter()
        # for each camera the rows that may be overwritten, the oldest first, with the times of their images
        self._rings: defaultdict[str, deque[tuple[int, float]]] = defaultdict(deque)
        self._steps = 0
        self._ended = self._told = False
        self._file = file
        self._writer.start()

    @property
    def failure(self) -> Exception | None:
        """The error after which the file cannot be written any more, or None without an error."""
        return self._writer.failure

    def frame(self, camera: str, frame: Frame, keep_s: float | None = None) -> int:
        """Record an image of a camera and return the image's row. The run file assigns the image to the
        current step.

        With `keep_s`, the image may be overwritten by one that was exposed more than this time in s later and
        may be overwritten too. Until then, and without `keep_s`, it stays in the file.
        """
        what = f"recording an image of {camera}"
        frame = replace(frame, image=self._own(camera, frame.image))
        with self._order:
            digest = self._hashing.submit(frame_digest, frame.image)
            ring, row = self._rings[camera], self._rows[camera]
            taken_s = frame.middle[0]
            again = keep_s is not None and bool(ring) and taken_s - ring[0][1] > keep_s
            if again:
                row = ring[0][0]
            step, order = self._steps, next(self._numbers)
            self._put(
                what,
                lambda file: file.add_frame(camera, row, frame, step, digest, order),
                camera=camera,
                size=0 if again else frame.image.nbytes,
            )
            if again:
                ring.popleft()
            else:
                self._rows[camera] += 1
            if keep_s is not None:
                ring.append((row, taken_s))
        return row

    def load_frame_state(self, state: LoadFrameState) -> None:
        """Append a reading of the load frame, if the rig has a load frame."""
        values = {name: getattr(state, name) for name in _LOAD_FRAME}
        if "load_frame" in self._devices:
            self._state("load_frame", "recording the load", values)

    def stage_state(self, state: StageState) -> None:
        """Append a reading of the stage, if the rig has a stage."""
        values = {name: getattr(state, name) for name in _STAGE}
        if "stage" in self._devices:
            self._state("stage", "recording the angle", values)

    def interlock_state(self, name: str, state: InterlockState) -> None:
        """Append a reading of an interlock, if the run file has this interlock."""
        values = {"value": state.value, "time_s": state.time_s}
        if name in self._interlocks:
            self._state(f"{schema.INTERLOCKS_GROUP}.{name}", f"recording interlock {name}", values)

    def samples(self, name: str, samples: TimedSamples) -> None:
        """Append samples of a channel device, if the run file has this device."""
        if (record := self._channels.get(name)) is None:
            return
        device = f"{schema.CHANNELS_GROUP}.{name}"
        with self._order:
            order = next(self._numbers)
            self._put(
                f"recording {device}",
                lambda file: file.add_samples(device, record.names, samples, order),
                # the values and the five other columns of each row
                size=8 * (len(record.names) + 5) * len(samples.values),
            )

    def settings(self, device: str, moment: schema.Moment, values: Mapping[str, str], time_s: float) -> None:
        """Append the settings that a device reported, by name, each value as JSON."""
        for name, value in values.items():
            with self._order:
                order = next(self._numbers)
                self._put(
                    f"recording the settings of {device}",
                    partial(
                        OpenRunFile.add_setting,
                        device=device,
                        moment=moment,
                        name=name,
                        value=value,
                        order=order,
                        time_s=time_s,
                    ),
                )

    def step(self, record: StepRecord) -> "Future[None]":
        """Append a finished step. The future is done when the step and its images are on the disk."""
        with self._order:
            order = next(self._numbers)
            done = self._put(
                f"recording {record.step}", lambda file: file.add_step(record, order), wait_for_disk=True
            )
            self._steps += 1
        return done

    def synchronise(self) -> "Future[None]":
        """Return a future that is done when everything recorded until now is on the disk."""
        return self._put("synchronising the run file with the disk", lambda _: None, wait_for_disk=True)

    def event(self, time_s: float, level: schema.Level, source: str, message: str) -> None:
        """Append an event to the run file. A message longer than 240 bytes is cut."""
        with self._order:
            order = next(self._numbers)
            self._put(
                "recording an event", lambda file: file.add_event(time_s, level, source, message, order)
            )

    def wait_for_room(self, camera: str, timeout_s: float) -> bool:
        """Wait until the queue has room for an image of `camera`. Return False after `timeout_s` seconds."""
        return self._writer.wait_for_room(camera, timeout_s)

    def close(self, status: schema.RunStatus, reason: str, end: datetime) -> None:
        """Write the status, the reason and the end time of the run, and close the file.

        The closed file has a digest and is read-only. A repeated call does nothing.

        Raises
        ------
        RecordingError
            If the file cannot be closed, or an earlier write failed and no call has raised its error yet.
        """
        with self._order:
            if self._ended:
                return
            self._ended = True
        ended = self._writer.end(lambda: self._end(status, reason, end))
        self._hashing.shutdown(wait=False)
        try:
            # Closing may take long, because it writes full queues, synchronises the file and computes its
            # digest.
            ended.result(_CLOSING_S + self._settings.answer_s)
        except TimeoutError as error:
            raise self._silence("closing the run file") from error
        failure = self._writer.failure
        if failure is not None and (status == "completed" or not self._told):
            raise failure

    def _end(self, status: schema.RunStatus, reason: str, end: datetime) -> None:
        """Close the file on the writer's thread."""
        failure = self._writer.failure
        try:
            self._file.require_in_place()
            self._file.require_untouched()
        except Misplaced as error:
            failure = self._writer.failure = failure or self._error("", error)
        except Overwritten as error:
            self._file.leave()
            self._writer.failure = failure or self._error("", error)
            raise self._writer.failure from error
        if failure is not None and status == "completed":
            status, reason = "failed", str(failure)
        try:
            self._file.close(status, reason, end)
        except (OSError, RuntimeError, ValueError) as error:
            self._file.abandon()
            self._writer.failure = failure or self._error("closing the run file", error)
            raise self._writer.failure from error

    def _own(self, camera: str, image: NDArray[Any]) -> NDArray[Any]:
        """Return an image that no other code can change: a copy, or the image itself if it is read-only."""
        info = self._cameras[camera]
        shape, dtype = (info.height_px, info.width_px), np.uint8 if info.bits <= 8 else np.uint16
        if image.shape != shape or image.dtype != dtype:
            raise RecordingError(
                f"recording an image of {camera}",
                f"{shape[1]} x {shape[0]} px as {np.dtype(dtype)}",
                f"shape {image.shape} as {image.dtype}",
                "mend the driver, which announces a format that it does not deliver",
            )
        if image.flags.owndata and not image.flags.writeable and image.flags.c_contiguous:
            return image
        return np.array(image, dtype, order="C")

    def _state(self, device: str, what: str, values: Mapping[str, float]) -> None:
        with self._order:
            numbered = {**values, "order": next(self._numbers)}
            self._put(what, lambda file: file.add_state(device, numbered))

    def _put(self, what: str, write: Callable[[OpenRunFile], None], **options: Any) -> "Future[None]":
        """Give a job to the writer's thread. Raise `RecordingError` if this thread cannot write any more."""
        if self._writer.failure is not None:
            self._told = True
            raise self._writer.failure
        if self._writer.busy_s() > self._settings.answer_s:
            raise self._silence(what)
        job = WriteJob(what, write, **options)
        if not self._ended and self._writer.put(job):
            return job.done
        if self._ended:
            raise self._error(what, ValueError("the run file is closed"))
        raise RecordingError(
            f"{self.path}, {what}",
            "a disk as fast as the devices",
            f"{self._settings.queue_frames} images of one camera that wait to be written",
            "write to a faster disk with -o, or raise recording.queue_frames in the rig file to "
            f"{2 * self._settings.queue_frames}",
        )

    def _error(self, what: str, error: BaseException) -> RecordingError:
        """Return the `RecordingError` for a failed write."""
        if isinstance(error, RecordingError):
            return error
        got = " ".join(str(error).split()) or type(error).__name__
        if isinstance(error, Misplaced):
            remedy = "let nobody move or delete the file of a run, or unmount its volume"
            return RecordingError(str(self.path), "the run file at this place", got, remedy)
        if isinstance(error, Overwritten):
            remedy = "let no other program write to the file of a run"
            return RecordingError(str(self.path), "the run file as it was written", got, remedy)
        remedy = "check free space and permissions of the folder, or name another file with -o"
        if isinstance(error, OSError) and error.errno in _FULL:
            got = error.strerror or got
        return RecordingError(str(self.path), f"{what} to succeed", got, remedy)

    def _silence(self, what: str) -> RecordingError:
        """Return the `RecordingError` for a disk that does not answer in time."""
        seconds = self._settings.answer_s
        return RecordingError(
            str(self.path),
            f"{what} to succeed",
            f"no answer of the disk within {seconds:g} s",
            f"write to a local disk with -o, or raise recording.answer_s in the rig file to {2 * seconds:g}",
        )


def run_file_exists(path: Path) -> RecordingError:
    """Return the `RecordingError` for a run file that exists already."""
    return RecordingError(
        str(path),
        "a new file",
        "one that exists",
        "name a new file with -o, or move the file away: a run is never overwritten, not even with --force",
    )
