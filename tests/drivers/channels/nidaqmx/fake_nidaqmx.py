"""An imitation of the package nidaqmx with one device that samples by its own clock.

It follows the descriptions of the package's functions. `test_real_package` compares all names, arguments and
numbers with the real package.
"""

import math
from enum import Enum
from types import SimpleNamespace
from typing import Any

import numpy as np

from drivers.clock import Clock

NO_LONGER, NOT_YET, REMOVED, REFUSED = -200279, -200284, -88709, -200077


class Error(Exception):
    pass


class DaqError(Error):
    def __init__(self, message: str, error_code: int) -> None:
        super().__init__(f"{message}\n\nStatus Code: {error_code}")
        self.error_code = error_code


class DaqReadError(DaqError):
    def __init__(self, message: str, error_code: int, samps_per_chan_read: int) -> None:
        super().__init__(message, error_code)
        self.samps_per_chan_read = samps_per_chan_read


class DaqNotFoundError(Error):
    pass


class AcquisitionType(Enum):
    CONTINUOUS = 10123


class OverwriteMode(Enum):
    OVERWRITE_UNREAD_SAMPLES = 10252
    DO_NOT_OVERWRITE_UNREAD_SAMPLES = 10159


class ReadRelativeTo(Enum):
    CURRENT_READ_POSITION = 10425
    MOST_RECENT_SAMPLE = 10428


class TerminalConfiguration(Enum):
    RSE = 10083
    NRSE = 10078
    DIFF = 10106
    PSEUDO_DIFF = 12529
    DEFAULT = -1


class FakeDaq:
    """One device, and the library that knows it.

    Attributes
    ----------
    volts : dict of str to float
        The voltage at each input. An input that is called ``number`` shows the number of the sample instead.
    plugged, clocked : bool
        False if the device is gone, or if its sample clock stands still.
    coerced_hz : float, optional
        The rate that the device chooses instead of the given one.
    open_tasks : int
    """

    def __init__(self, clock: Clock) -> None:
        self.clock = clock
        self.volts: dict[str, float] = {}
        self.numbered: set[str] = set()
        self.plugged = self.clocked = True
        self.coerced_hz: float | None = None
        self.open_tasks = 0
        self.tasks: list[Task] = []
        self.constants = SimpleNamespace(
            AcquisitionType=AcquisitionType,
            OverwriteMode=OverwriteMode,
            ReadRelativeTo=ReadRelativeTo,
            TerminalConfiguration=TerminalConfiguration,
        )
        self.errors = SimpleNamespace(Error=Error, DaqError=DaqError, DaqReadError=DaqReadError)
        self.stream_readers = SimpleNamespace(AnalogMultiChannelReader=AnalogMultiChannelReader)
        self.system = SimpleNamespace(Device=self._device)

    def Task(self) -> "Task":  # noqa: N802 - the package's name
        self.open_tasks += 1
        self.tasks.append(Task(self))
        return self.tasks[-1]

    def _device(self, name: str) -> Any:
        if name != "Dev1" or not self.plugged:
            raise DaqError(f"Device identifier is invalid.\n\nDevice Specified: {name}", -200220)
        return SimpleNamespace(product_type="USB-6001", serial_num=0x1A2B3C)

    def require_plugged(self) -> None:
        if not self.plugged:
            raise DaqError("Operation aborted because the device was removed.", REMOVED)


class Task:
    def __init__(self, daq: FakeDaq) -> None:
        self.daq = daq
        self.ai_channels = self.timing = self.in_stream = self
        self.channels: list[dict[str, Any]] = []
        self.overwrite = OverwriteMode.DO_NOT_OVERWRITE_UNREAD_SAMPLES
        self.relative_to, self.offset = ReadRelativeTo.CURRENT_READ_POSITION, 0
        self.curr_read_pos = 0
        self._stood_s: float | None = None
        self._before_stop = 0
        self._open = True

    def add_ai_voltage_chan(self, physical_channel, *, terminal_config, min_val, max_val):
        self.daq.require_plugged()
        device, _, name = physical_channel.partition("/")
        if device != "Dev1" or name not in self.daq.volts:
            raise DaqError(f"Physical channel specified does not exist on this device: {name}", -200170)
        self.channels.append({"name": name, "terminals": terminal_config, "low": min_val, "high": max_val})

    def cfg_samp_clk_timing(self, rate, *, sample_mode, samps_per_chan):
        assert sample_mode is AcquisitionType.CONTINUOUS
        self.samp_clk_rate = self.daq.coerced_hz or rate
        self.buffer = samps_per_chan

    def start(self):
        self.daq.require_plugged()
        self._begun_s = self.daq.clock.now_s()

    def close(self):
        if self._open:
            self._open = False
            self.daq.open_tasks -= 1
            self.daq.require_plugged()

    @property
    def total(self) -> int:
        """Number of samples that the device has taken."""
        if not self.daq.clocked:
            return self._before_stop
        seconds = self.daq.clock.now_s() - self._begun_s
        self._before_stop = math.floor(seconds * self.samp_clk_rate + 1e-6)
        return self._before_stop

    @property
    def avail_samp_per_chan(self) -> int:
        self.daq.require_plugged()
        return self.total - self.curr_read_pos

    def fetched(self, data: np.ndarray, count: int, timeout: float) -> int:
        """Fill `data` as the library does, and return the number of samples of each channel."""
        self.daq.require_plugged()
        if self.relative_to is ReadRelativeTo.MOST_RECENT_SAMPLE:
            self.curr_read_pos = self.total + self.offset
        missing = self.curr_read_pos + count - self.total
        if missing > 0:
            self.daq.clock.sleep(min(missing / self.samp_clk_rate + 1e-6, timeout))
            self.daq.require_plugged()
        if self.total - self.curr_read_pos > self.buffer:
            assert self.overwrite is OverwriteMode.OVERWRITE_UNREAD_SAMPLES
            raise DaqReadError("The application is not able to keep up.", NO_LONGER, 0)
        got = max(0, min(count, self.total - self.curr_read_pos))
        numbers = np.arange(self.curr_read_pos, self.curr_read_pos + got)
        flat = data.reshape(-1)
        for place, channel in enumerate(self.channels):
            name = channel["name"]
            volts = np.clip(self.daq.volts[name], channel["low"], channel["high"])
            flat[place * got : (place + 1) * got] = numbers if name in self.daq.numbered else volts
        self.curr_read_pos += got
        if got < count:
            raise DaqReadError(
                "Some or all of the samples requested have not yet been acquired.", NOT_YET, got
            )
        return got


class AnalogMultiChannelReader:
    def __init__(self, in_stream: Task) -> None:
        self._task = in_stream

    def read_many_sample(self, data, number_of_samples_per_channel, timeout):
        assert data.shape == (len(self._task.channels), number_of_samples_per_channel)
        assert data.dtype == np.float64
        return self._task.fetched(data, number_of_samples_per_channel, timeout)
