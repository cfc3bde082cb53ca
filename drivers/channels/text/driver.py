"""The driver `text-channels`: instruments that answer with, or send, lines of text."""

from drivers.channels.text.asked import AskedText
from drivers.channels.text.sending import SendingText
from drivers.channels.text.settings import TextChannelSettings
from drivers.interfaces import OpenContext
from drivers.registry import DriverSpec


def open_channels(settings: TextChannelSettings, context: OpenContext) -> AskedText | SendingText:
    """Open the line, identify the instrument, send the opening commands, and read it once.

    Raise `DeviceError` if the instrument cannot be opened, is another one, or reports an error.
    """
    return SendingText(settings, context) if settings.stream else AskedText(settings, context)


SPEC = DriverSpec(kind="channels", settings=TextChannelSettings, open=open_channels)
