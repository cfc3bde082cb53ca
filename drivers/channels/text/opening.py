"""Open the line to a text instrument, and name the instrument."""

from drivers.channels.text.settings import ENDS, VISA_PREFIX, TextChannelSettings
from drivers.errors import LinkLost
from drivers.interfaces import DeviceInfo
from drivers.lines.channel import (
    CHANNEL_ERRORS,
    TCP_PREFIX,
    Channel,
    SerialChannel,
    cannot_open,
    open_channel,
)
from drivers.lines.echo import EchoedChannel
from drivers.lines.visa_channel import VisaChannel, VisaSerial


def open_line(name: str, address: str, settings: TextChannelSettings) -> Channel:
    """Open the line to an instrument. `address` is no ``@name``. Raise `LinkLost` if this fails."""
    timeout_s = settings.reply_timeout_s
    serial = settings.baud, settings.data_bits, settings.parity, settings.stop_bits
    try:
        if address.startswith(VISA_PREFIX):
            resource, end = address.removeprefix(VISA_PREFIX), ENDS[settings.line_end][-1:]
            return VisaChannel(resource, settings.visa_library, end, VisaSerial(*serial), timeout_s)
        if address.startswith(TCP_PREFIX):
            channel = open_channel(address, settings.baud, timeout_s)
        else:
            baud, data_bits, parity, stop_bits = serial
            channel = SerialChannel(address, baud, parity, stop_bits, timeout_s, data_bits)
    except ImportError as error:
        remedy = 'install it with: pip install "offaxis[visa]"'
        raise LinkLost(name, "open", "the package PyVISA", f"none ({error})", remedy) from error
    except CHANNEL_ERRORS as error:
        if address.startswith(VISA_PREFIX):
            remedy = "check the resource's name, the library and the cable"
            raise LinkLost(name, "open", "a VISA resource", str(error), remedy) from error
        raise cannot_open(name, "open port", address, error) from error
    return EchoedChannel(channel, settings.baud) if settings.echo else channel


def identity(settings: TextChannelSettings, answer: str) -> DeviceInfo:
    """Return the identity of an instrument from its identification, or from its address without one.

    The answer to ``*IDN?`` has maker, model, serial number and firmware, with commas between them (IEEE
    488.2).
    """
    simulated = settings.address.startswith("@")
    parts = [part.strip() for part in answer.split(",")]
    if len(parts) == 4 and all(parts[:2]):
        vendor, model, serial, firmware = parts
        return DeviceInfo(vendor, model, serial, firmware, simulated)
    return DeviceInfo("text instrument", answer or settings.address, "", simulated=simulated)
