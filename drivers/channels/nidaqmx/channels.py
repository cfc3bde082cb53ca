"""Driver for the voltage inputs of National Instruments' devices, sampled by the device's own clock.

This driver has never been run with a real device. It is tested with an imitation of the library, whose
names and arguments are compared with the real package.
"""

import contextlib
import threading
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.channels.nidaqmx.library import NO_LONGER, NOT_YET, load_library, terminals_of, told
from drivers.channels.nidaqmx.settings import NidaqmxSettings
from drivers.errors import DeviceFault, LinkLost
from drivers.interfaces import DeviceInfo, OpenContext
from drivers.registry import DriverSpec
from drivers.signals import Samples, Signal


class NidaqmxChannels:
    """The voltage inputs of one device. To construct this class, call `open_channels`.

    The library collects the samples in a buffer. If the program is busy for longer than the buffer lasts, the
    oldest samples are lost, and their numbers are missing. A device that was unplugged is opened again by the
    next reading; the numbers and times of its samples then go on by the clock of the rig.
    """

    def __init__(self, settings: NidaqmxSettings, context: OpenContext, library: Any) -> None:
        self._settings, self._clock, self._library = settings, context.clock, library
        self._name = f"{context.name} ({settings.device})"
        self._turn = threading.Lock()
        self._task: Any = None
        self._closed = False
        # number of the first sample of the present task, and of the sample that is read next
        self._base = self._next = 0
        self._received_s = self._clock.now_s()
        self.signals: tuple[Signal, ...] = settings.declared
        try:
            device = library.system.Device(settings.device)
            model, serial = str(device.product_type), f"{device.serial_num:X}"
        except library.errors.Error as error:
            raise told(error, self._name, "open", f"a device called {settings.device}") from error
        self.info = DeviceInfo(vendor="National Instruments", model=model, serial=serial)
        self._start()
        self.rate_hz: float = self._rate_hz

    def _start(self) -> None:
        """Create the task, and let the device begin to sample."""
        settings, constants = self._settings, self._library.constants
        task = None
        try:
            task = self._library.Task()
            for each in settings.signals.values():
                task.ai_channels.add_ai_voltage_chan(
                    f"{settings.device}/{each.input}",
                    terminal_config=terminals_of(constants, each.terminals),
                    min_val=-each.volts,
                    max_val=each.volts,
                )
            task.timing.cfg_samp_clk_timing(
                settings.rate_hz,
                sample_mode=constants.AcquisitionType.CONTINUOUS,
                samps_per_chan=settings.buffer,
            )
            # The acquisition goes on if the buffer is full, so that no fault ends it.
            task.in_stream.overwrite = constants.OverwriteMode.OVERWRITE_UNREAD_SAMPLES
            self._reader = self._library.stream_readers.AnalogMultiChannelReader(task.in_stream)
            task.start()
            self._rate_hz = float(task.timing.samp_clk_rate)
        except self._library.errors.Error as error:
            self._release(task)
            inputs = ", ".join(each.input for each in settings.signals.values())
            expected = f"the inputs {inputs} at {settings.rate_hz:g} Hz"
            raise told(error, self._name, "start sampling", expected) from error
        self._task = task

    def read(self, timeout_s: float) -> Samples:
        """Return the samples of one block, or all since the last call if these are more.

        Raise `DeviceTimeout` if none comes within `timeout_s`, `LinkLost` if the device is gone, and
        `DeviceFault` for every other error of the library.
        """
        with self._turn:
            if self._closed:
                raise LinkLost(self._name, "read", "an open device", "a closed one", "open it again")
            if self._task is None:
                self._restart()
            try:
                volts = self._volts(timeout_s)
            except self._library.errors.Error as error:
                lost = told(error, self._name, "read", f"samples within {timeout_s:.3g} s")
                if getattr(error, "error_code", None) != NOT_YET:
                    self._drop()
                raise lost from error
            first, self._next = self._next, self._next + len(volts)
            self._received_s = self._clock.now_s()
        numbers = np.arange(first, first + len(volts))
        return Samples(
            self._settings.in_units(volts),
            first,
            received_s=self._received_s,
            device_s=numbers / self._rate_hz,
        )

    def _volts(self, timeout_s: float) -> NDArray[np.float64]:
        """Return the next voltages (n, signals)."""
        waiting = int(self._task.in_stream.avail_samp_per_chan)
        # not more than the buffer, also if the library says that more wait
        count = min(max(waiting, self._settings.block), self._settings.buffer // 2)
        try:
            return self._block(count, timeout_s)
        except self._library.errors.DaqReadError as error:
            if error.error_code != NO_LONGER:
                raise
        return self._newest(timeout_s)

    def _block(self, count: int, timeout_s: float) -> NDArray[np.float64]:
        """Return up to `count` voltages of each input from the present place in the buffer."""
        data = np.full((len(self.signals), count), np.nan)
        try:
            got = int(self._reader.read_many_sample(data, count, max(0.0, timeout_s)))
        except self._library.errors.DaqReadError as error:
            got = int(error.samps_per_chan_read)
            if error.error_code != NOT_YET or got == 0:
                raise
        # The library puts the samples of an input right behind those of the input before.
        return data.ravel()[: len(self.signals) * got].reshape(len(self.signals), got).T.copy()

    def _newest(self, timeout_s: float) -> NDArray[np.float64]:
        """Return the newest block, after the samples before it were overwritten."""
        stream, relative = self._task.in_stream, self._library.constants.ReadRelativeTo
        stream.relative_to, stream.offset = relative.MOST_RECENT_SAMPLE, -self._settings.block
        try:
            volts = self._block(self._settings.block, timeout_s)
        finally:
            stream.relative_to, stream.offset = relative.CURRENT_READ_POSITION, 0
        first = self._base + int(stream.curr_read_pos) - len(volts)
        if first < self._next:
            raise DeviceFault(
                self._name,
                "read on after lost samples",
                f"a sample after number {self._next - 1}",
                f"number {first}",
                "open the device again",
            )
        self._next = first
        return volts

    def _restart(self) -> None:
        """Open a device again that was gone. Its samples go on by the clock of the rig."""
        self._start()
        gone_s = self._clock.now_s() - self._received_s
        self._base = self._next = self._next + max(1, round(gone_s * self._rate_hz))

    def _drop(self) -> None:
        task, self._task = self._task, None
        self._release(task)

    def _release(self, task: Any) -> None:
        """End a task. Also if the device is gone and this fails, the library releases the task."""
        if task is not None:
            with contextlib.suppress(self._library.errors.Error):
                task.close()

    def close(self) -> None:
        """End the acquisition and release the device. A repeated call has no effect."""
        with self._turn:
            self._closed = True
            self._drop()


def open_channels(settings: NidaqmxSettings, context: OpenContext, library: Any = None) -> NidaqmxChannels:
    """Open the device and begin to sample. `library` replaces the package ``nidaqmx``.

    Raise `DeviceError` if the package, the maker's library or the device is missing.
    """
    return NidaqmxChannels(settings, context, library or load_library(context.name))


SPEC = DriverSpec(kind="channels", settings=NidaqmxSettings, open=open_channels)
