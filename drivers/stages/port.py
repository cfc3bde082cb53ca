"""Base class of the ports of all stages."""

from typing import ClassVar

from drivers.lines.device_port import DevicePort


class StagePort(DevicePort):
    """An exclusive port to a stage."""

    silence_remedy: ClassVar[str] = "check power, cable, baud rate, device address and axis"
    lost_remedy: ClassVar[str] = "check the cable, then open the stage again and home it"
