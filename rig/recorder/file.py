"""The run file during recording: tables, disk space, synchronisation, closing and the file's digest."""

import errno
import os
from collections.abc import Mapping, Sequence
from concurrent.futures import Future
from contextlib import suppress
from datetime import datetime
from functools import partial
from pathlib import Path

import h5py

from dic.runfile import lock, schema
from dic.runfile.chunks import pixel_places
from dic.runfile.digests import BLOCK_BYTES, UserBlock, file_digest
from dic.runfile.superblock import SUPERBLOCK_BYTES, mark_closed
from drivers.interfaces import CameraInfo, DeviceInfo, Frame
from rig.recorder.place import content, require_in_place, require_untouched, rescue
from rig.recorder.records import (
    NO_CHANNELS,
    NO_INTERLOCKS,
    ChannelsRecord,
    InterlockRecord,
    RunHeader,
    StepRecord,
)
from rig.recorder.space import ReservedSpace
from rig.recorder.tables import CameraTable, Table, create_entry, create_group, create_text, fit
from rig.samples import TimedSamples
from rig.threads import never_release

ROW_BYTES = 256 << 10
"""Largest growth of the file by one row of any table, in bytes, including new chunks and their index."""

_CACHE_BYTES = 64 << 10
"""Size in bytes of HDF5's cache of each column. The default of 1 MiB would fill up slowly in a long run."""


class OpenRunFile:
    """A new run file. Only one thread may use it at a time.

    Every method raises OSError or RuntimeError if the file cannot be written. After such an error of a method
    other than `require_space`, call `abandon`.

    `path` is the new file. An existing file is never overwritten. `devices` has the identities of ``stage``
    and ``load_frame``, if the rig has these devices.
    """

    def __init__(
        self,
        path: Path,
        header: RunHeader,
        cameras: Mapping[str, CameraInfo],
        devices: Mapping[str, DeviceInfo],
        interlocks: Mapping[str, InterlockRecord] = NO_INTERLOCKS,
        channels: Mapping[str, ChannelsRecord] = NO_CHANNELS,
    ) -> None:
        self._path = unfinished = _unfinished(path)
        self._abandoned = False
        self._beginning, self._bytes = b"", 0
        self._descriptor = _new(unfinished, path)
        try:
            self._hdf5 = _created(unfinished)
        except BaseException:
            os.close(self._descriptor)
            unfinished.unlink()
            raise
        try:
            self._space = ReservedSpace(self._descriptor)
            texts = [header.definition, header.configuration, header.provenance, *header.devices.values()]
            tables = len(cameras) + len(interlocks) + len(channels) + 5
            self.require_space(len("".join(texts).encode()) + tables * ROW_BYTES)
            self._create(header, cameras, devices, interlocks, channels)
            # Rename the file only now, so that a program killed earlier leaves no run file that cannot be
            # read.
            if path.exists():
                raise FileExistsError(path)
            self._path = unfinished.rename(path)
            # No program can open the file for writing now, unless it has the rights of the administrator.
            with suppress(OSError):  # some file systems have no permissions
                os.fchmod(self._descriptor, os.fstat(self._descriptor).st_mode & ~0o222)
            _synchronise_folder(path.parent)
        except BaseException:
            self.abandon()
            with suppress(OSError):
                unfinished.unlink()
            raise

    def _create(
        self,
        header: RunHeader,
        cameras: Mapping[str, CameraInfo],
        devices: Mapping[str, DeviceInfo],
        interlocks: Mapping[str, InterlockRecord],
        channels: Mapping[str, ChannelsRecord],
    ) -> None:
        self._entry = create_entry(self._hdf5, header)
        instrument = create_group(self._entry, "instrument", schema.INSTRUMENT)
        self._cameras = {
            name: CameraTable(instrument, name, info, self._descriptor) for name, info in cameras.items()
        }
        layouts = {"stage": schema.STAGE, "load_frame": schema.LOAD_FRAME}
        self._states = {
            name: Table(create_group(instrument, name, layouts[name], info), layouts[name])
            for name, info in devices.items()
        }
        for name in (*self._cameras, *self._states):
            create_text(instrument[name], schema.SETTINGS, header.devices.get(name, "{}"))
        if interlocks:
            self._create_interlocks(header, interlocks)
        if channels:
            self._create_channels(header, channels)
        steps = schema.steps(cameras)
        self._steps = Table(create_group(self._entry, "steps", steps), steps)
        self._events = Table(create_group(self._entry, "events", schema.EVENTS), schema.EVENTS)
        reported = create_group(self._entry, schema.REPORTED_GROUP, schema.REPORTED)
        self._reported = Table(reported, schema.REPORTED)
        # Readers in SWMR mode (single writer, multiple readers) cannot see datasets that are created
        # later, so all datasets must exist before SWMR mode is switched on.
        self._hdf5.swmr_mode = True
        self._hdf5.flush()
        # Reserve the space behind the data again, because the flush has cut the file off after its data.
        self._space = ReservedSpace(self._descriptor)
        self.require_space(0)
        self._superblock = os.pread(self._descriptor, SUPERBLOCK_BYTES, BLOCK_BYTES)
        self._write_block(UserBlock(self._superblock))
        self.synchronise()

    def _create_interlocks(self, header: RunHeader, interlocks: Mapping[str, InterlockRecord]) -> None:
        parent = create_group(self._entry, schema.INTERLOCKS_GROUP, schema.INTERLOCKS)
        for name, interlock in interlocks.items():
            device = f"{schema.INTERLOCKS_GROUP}.{name}"
            group = create_group(parent, name, schema.INTERLOCK, interlock)
            self._states[device] = Table(group, schema.INTERLOCK)
            create_text(group, schema.SETTINGS, header.devices.get(device, "{}"))

    def _create_channels(self, header: RunHeader, channels: Mapping[str, ChannelsRecord]) -> None:
        parent = create_group(self._entry, schema.CHANNELS_GROUP, schema.CHANNELS)
        for name, record in channels.items():
            device = f"{schema.CHANNELS_GROUP}.{name}"
            layout = schema.channels(record.names)
            group = create_group(parent, name, layout, record.info)
            self._states[device] = Table(group, layout)
            create_text(group, schema.SETTINGS, header.devices.get(device, "{}"))
            create_text(group, schema.SIGNALS, record.as_json())

    def require_space(self, size: int) -> None:
        """Reserve disk space for `size` more bytes and for closing the file. Raise OSError if there is too
        little."""
        self._space.require(self._hdf5.id.get_filesize(), size)

    def add_frame(
        self, camera: str, row: int, frame: Frame, step: int, digest: "Future[str]", order: int
    ) -> None:
        """Put an image into a row of its camera's table: the first free one, or one whose image is given up.

        `step` is the row of the step to which the image belongs.
        """
        self._cameras[camera].put(row, frame, step, digest, order)

    def add_state(self, device: str, values: Mapping[str, float]) -> None:
        """Add a reading of the stage, of the load frame, or of an interlock such as ``interlocks.door``."""
        self._states[device].append(**values)

    def add_samples(self, device: str, names: Sequence[str], samples: TimedSamples, order: int) -> None:
        """Add the samples of a channel device such as ``channels.box``, whose signals have these `names`."""
        count = len(samples.values)
        values = {schema.value_of(name): samples.values[:, k] for k, name in enumerate(names)}
        self._states[device].extend(
            {
                "number": range(samples.first, samples.first + count),
                "device_s": samples.device_s,
                "time_s": samples.time_s,
                "time_std_s": samples.time_std_s,
                "order": [order] * count,
                **values,
            }
        )

    def add_step(self, record: StepRecord, order: int) -> None:
        """Add a finished step, whose images must have been added before."""
        firsts = {schema.first_row(name): first for name, (first, _) in record.frames.items()}
        counts = {schema.row_count(name): count for name, (_, count) in record.frames.items()}
        self._steps.append(
            index=record.step.index,
            kind=record.step.kind,
            target=record.step.target,
            load_n=record.reading.load_n,
            displacement_mm=record.reading.displacement_mm,
            angle_deg=record.reading.angle_deg,
            time_s=record.reading.time_s,
            due_s=record.due_s,
            **firsts,
            **counts,
            order=order,
            complete=1,
        )

    def add_event(self, time_s: float, level: schema.Level, source: str, message: str, order: int) -> None:
        """Add an event to the table of events."""
        self._events.append(level=level, source=source, message=message, order=order, time_s=time_s)

    def add_setting(self, device: str, moment: schema.Moment, name: str, value: str, **row: float) -> None:
        """Add a setting that a device reported. `value` is JSON, and `row` has `order` and `time_s`."""
        self._reported.append(device=device, moment=moment, name=name, value=value, **row)

    def commit(self) -> None:
        """Write all added rows: pixels before the rows that mark them valid, and images before their step."""
        for camera in self._cameras.values():
            camera.write()
            camera.table.acknowledge()
        for table in (*self._states.values(), self._steps, self._events, self._reported):
            table.write()
            table.acknowledge()
        self._bytes = os.fstat(self._descriptor).st_size

    def synchronise(self) -> None:
        """Synchronise the file with the disk (`fsync`).

        Raise `Misplaced` if it has left its path, and `Overwritten` if another program has changed it.
        """
        os.fsync(self._descriptor)
        self.require_in_place()
        self.require_untouched()

    def require_untouched(self) -> None:
        """Raise `Overwritten` if another program has emptied the file or written to its beginning."""
        if not self._abandoned:
            require_untouched(self._descriptor, self._beginning, self._bytes)

    def require_in_place(self) -> None:
        """Raise `Misplaced` if the file is not at its path any more. The file can then still be closed."""
        if not self._abandoned:
            require_in_place(self._descriptor, self._path)

    def close(self, status: schema.RunStatus, reason: str, end: datetime) -> None:
        """Write the status of the run, close the file, write the file's digest, and make the file
        read-only. The data of a deleted file are copied to a new one."""
        if self._abandoned or not self._hdf5:
            return
        # Write the status last, so that a file with the status "completed" is complete.
        for name, text in (("status_reason", reason), ("end_time", end.isoformat()), ("status", status)):
            dataset = self._entry[name]
            dataset[()] = fit(text, dataset.dtype.itemsize)
            dataset.flush()
        pixels = [place for camera in self._cameras.values() for place in pixel_places(camera.data).values()]
        os.fsync(self._descriptor)
        self._hdf5.close()
        written = os.fstat(self._descriptor)
        self._space.release(written.st_size)
        self._write_block(
            UserBlock(self._superblock, file_digest(content(self._descriptor, self._path), pixels))
        )
        os.fsync(self._descriptor)
        with suppress(PermissionError):  # a file system like FAT has no permissions
            os.fchmod(self._descriptor, written.st_mode & ~0o222)
        rescue(self._descriptor, self._path)
        self._release_descriptor()
        with suppress(OSError):  # the folder may be gone, but then the file is not in it
            _synchronise_folder(self._path.parent)

    def abandon(self) -> None:
        """Release a file that cannot be written any more. Data that are already on the disk stay there.

        HDF5 writes when it closes a file, and h5py may crash when it releases a file whose close failed. So
        HDF5's file descriptor is first replaced by that of a file in memory, where the last writes succeed
        and have no effect. Then the run file is marked as closed, so that every program can open it. HDF5 may
        still keep its file open. Therefore `close` does nothing after `abandon`: HDF5 would read from the
        empty file in memory, and repeat these reads for ever.
        """
        self._abandoned = True
        if self._hdf5:
            try:
                memory = os.memfd_create("abandoned run file")
                os.dup2(memory, self._hdf5.id.get_vfd_handle())
                os.close(memory)
                self._hdf5.close()
            except (OSError, RuntimeError, ValueError):
                never_release(self.__dict__.copy())
        with suppress(OSError, ValueError):
            mark_closed(self._path, self._descriptor)
        with suppress(OSError):
            self._release_descriptor()

    def leave(self) -> None:
        """Release a file that another program has overwritten, and write nothing to it any more.

        HDF5 would read its own tables again, find others, and repeat these reads for ever.
        """
        self._abandoned = True
        with suppress(OSError, RuntimeError, ValueError):
            memory = os.memfd_create("overwritten run file")
            os.dup2(memory, self._hdf5.id.get_vfd_handle())
            os.close(memory)
        never_release(self.__dict__.copy())
        with suppress(OSError):
            self._release_descriptor()

    def _write_block(self, block: UserBlock) -> None:
        self._beginning = block.to_bytes()
        os.pwrite(self._descriptor, self._beginning, 0)

    def _release_descriptor(self) -> None:
        if self._descriptor >= 0:
            os.close(self._descriptor)
            self._descriptor = -1


def _created(path: Path) -> h5py.File:
    """Return an empty HDF5 file whose small blocks each lie in one page of the operating system's memory.

    A write that a killed program had begun is done up to the end of a page. If one half of a block with a
    checksum were new and the other half old, nothing behind this block could be read.
    """
    create = partial(
        h5py.File,
        path,
        "w",
        libver="latest",
        userblock_size=BLOCK_BYTES,
        rdcc_nbytes=_CACHE_BYTES,
        fs_strategy="page",
        fs_page_size=BLOCK_BYTES,
    )
    try:
        return create()
    except OSError as error:
        # HDF5 accepts a file system without locks only if it is told to use none.
        if error.errno not in (errno.ENOLCK, errno.EOPNOTSUPP):
            raise
        return create(locking=False)


def _unfinished(path: Path) -> Path:
    """Return the name that a run file has until other programs can read it."""
    return path.with_name(f".{path.name}.unfinished")


def _new(unfinished: Path, path: Path) -> int:
    """Return a locked descriptor of an empty file, which only this program can rename to the run file `path`.

    A file that a killed program has left under this name is emptied. Raise `FileExistsError` if the run file
    exists, or if another program creates it now.
    """
    descriptor = os.open(unfinished, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC, 0o666)
    try:
        try:
            lock.hold(descriptor)
        except BlockingIOError as error:
            raise FileExistsError(f"{path} is created by another program") from error
        except OSError:  # ignore the error, because this file system has no locks
            pass
        # Refuse if another program has renamed this file to its run file before this program got the lock.
        if not os.path.samestat(os.fstat(descriptor), unfinished.stat()):
            raise FileExistsError(f"{path} was created by another program")
        if path.exists():
            unfinished.unlink()
            raise FileExistsError(path)
    except BaseException:
        os.close(descriptor)
        raise
    return descriptor


def _synchronise_folder(folder: Path) -> None:
    """Synchronise `folder` with the disk, so that a new file in it still exists after a power failure."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    except OSError:  # ignore the error, because some network file systems cannot synchronise a folder
        pass
    finally:
        os.close(descriptor)
