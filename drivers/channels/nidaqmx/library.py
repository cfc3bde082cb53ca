"""The maker's library: loading it, and the meaning of its errors."""

from types import ModuleType
from typing import Any

from drivers.errors import DeviceError, DeviceFault, DeviceTimeout, LinkLost

NOT_YET, NO_LONGER = -200284, -200279
"""Codes of the errors: the samples have not come in time, or have been overwritten."""
GONE = (-200045, -200220, -200324, -201003, -201190, -89130, -88709, -88705, -50300)
"""Codes of the errors of a device that is not there, not reachable, or was removed."""


def load_library(name: str) -> ModuleType:
    """Return the package ``nidaqmx``. `name` is the name of the device for the error message.

    Raise `DeviceFault` if the package is not installed.
    """
    try:
        import nidaqmx
        import nidaqmx.constants
        import nidaqmx.errors
        import nidaqmx.stream_readers
        import nidaqmx.system
    except ImportError as error:
        raise DeviceFault(
            name,
            "load NI-DAQmx",
            "the Python package nidaqmx",
            str(error),
            'install it: pip install "offaxis[daqmx]"',
        ) from error
    return nidaqmx  # type: ignore[no-any-return]


def told(error: Exception, name: str, step: str, expected: str) -> DeviceError:
    """Return the error of the library as one sentence about the device called `name`."""
    code = getattr(error, "error_code", None)
    said = _first_line(error)
    if code is None:
        remedy = "install the driver NI-DAQmx of National Instruments for this system"
        return DeviceFault(name, step, "the maker's library NI-DAQmx", said, remedy)
    got = f"{said} (NI-DAQmx {code})"
    if code == NOT_YET:
        remedy = "allow more time than one block of samples, and check that the sample clock runs"
        return DeviceTimeout(name, step, expected, got, remedy)
    if code in GONE:
        return LinkLost(name, step, expected, got, "check the cable, the power and the name in NI MAX")
    return DeviceFault(name, step, expected, got, "look the number up in the manual of NI-DAQmx")


def _first_line(error: Exception) -> str:
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    return lines[0].rstrip(".") if lines else type(error).__name__


def terminals_of(constants: Any, terminals: str) -> Any:
    """Return the library's constant for the wiring of an input."""
    kinds = constants.TerminalConfiguration
    return {
        "default": kinds.DEFAULT,
        "differential": kinds.DIFF,
        "rse": kinds.RSE,
        "nrse": kinds.NRSE,
        "pseudo-differential": kinds.PSEUDO_DIFF,
    }[terminals]
