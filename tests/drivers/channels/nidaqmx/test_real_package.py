"""The imitation of the library, and the driver's numbers, agree with the real package nidaqmx."""

import inspect

import pytest

from drivers.channels.nidaqmx import library
from drivers.channels.nidaqmx.channels import open_channels
from drivers.channels.nidaqmx.settings import NidaqmxSettings
from drivers.errors import DeviceFault
from drivers.interfaces import OpenContext
from drivers.testing.common import assert_says_all
from tests.drivers.channels.nidaqmx import fake_nidaqmx
from tests.drivers.channels.nidaqmx.conftest import FORCE

nidaqmx = pytest.importorskip("nidaqmx", reason="needs the extra daqmx: pip install offaxis[daqmx]")


def installed() -> bool:
    try:
        return nidaqmx.system.System.local().driver_version is not None
    except nidaqmx.errors.Error:
        return False


def test_constants_have_their_names_and_numbers():
    kinds = ("AcquisitionType", "OverwriteMode", "ReadRelativeTo", "TerminalConfiguration")
    real = library.load_library("device").constants
    for kind in kinds:
        for each in getattr(fake_nidaqmx, kind):
            assert getattr(real, kind)[each.name].value == each.value


def test_error_codes_mean_what_the_driver_takes_them_for():
    codes = nidaqmx.error_codes.DAQmxErrors
    assert codes(library.NOT_YET) is codes.SAMPLES_NOT_YET_AVAILABLE
    assert codes(library.NO_LONGER) is codes.SAMPLES_NO_LONGER_AVAILABLE
    words = ("REMOVED", "INVALID_DEVICE", "ABSENT", "CANNOT_BE_ACCESSED", "REPLUG", "NOT_FOUND", "ABORTED")
    assert [code for code in library.GONE if not any(word in codes(code).name for word in words)] == []


def test_errors_carry_what_the_driver_reads():
    error = nidaqmx.errors.DaqReadError("no", library.NOT_YET, samps_per_chan_read=3)
    assert (error.error_code, error.samps_per_chan_read) == (library.NOT_YET, 3)
    assert isinstance(error, nidaqmx.errors.Error)


def test_functions_take_the_arguments_of_the_driver():
    collection = nidaqmx.task.collections.AIChannelCollection
    bind = {
        collection.add_ai_voltage_chan: (("self", "Dev1/ai0"), ("terminal_config", "min_val", "max_val")),
        nidaqmx.task.Timing.cfg_samp_clk_timing: (("self", 10.0), ("sample_mode", "samps_per_chan")),
        library.load_library("device").stream_readers.AnalogMultiChannelReader.read_many_sample: (
            ("self", "data", 10, 1.0),
            (),
        ),
    }
    for function, (given, named) in bind.items():
        assert inspect.signature(function).bind(*given, **dict.fromkeys(named)) is not None
    reading = inspect.signature(list(bind)[-1]).parameters
    assert list(reading)[1:] == ["data", "number_of_samples_per_channel", "timeout"]


@pytest.mark.parametrize(
    ("owner", "names", "writable"),
    [
        ("InStream", ("overwrite", "relative_to", "offset"), True),
        ("InStream", ("avail_samp_per_chan", "curr_read_pos"), False),
        ("Timing", ("samp_clk_rate",), True),
    ],
)
def test_properties_exist(owner, names, writable):
    for name in names:
        found = getattr(getattr(nidaqmx.task, owner), name)
        assert isinstance(found, property)
        assert (found.fset is not None) == writable


def test_devices_tell_model_and_serial_number():
    device = library.load_library("device").system.Device
    assert isinstance(device.product_type, property)
    assert isinstance(device.serial_num, property)


def test_without_the_makers_library_opening_says_so(clock):
    if installed():
        pytest.skip("the maker's library is on this machine")
    settings = NidaqmxSettings.model_validate({"device": "Dev1", "rate_hz": 10.0, "signals": {"a": FORCE}})
    with pytest.raises(DeviceFault, match=r"Could not find an installation of NI-DAQmx") as raised:
        open_channels(settings, OpenContext("channels.ni", clock))
    assert_says_all(raised.value)
