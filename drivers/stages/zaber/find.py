"""Find the Zaber devices at a serial port. Every device on the line answers with its address."""

from drivers.lines.serial_ports import ANSWER_S, lines_answered, serial_ports
from drivers.registry import Finder, Found
from drivers.stages.zaber.port import BAUD
from drivers.stages.zaber.protocol import DamagedLineError, decode, encode


def zaber_stages(url: str) -> list[Found]:
    """Return the Zaber devices at a serial port or behind ``socket://host:port``.

    Raise `OSError` if the port cannot be opened or used.
    """
    found = []
    for line in lines_answered(url, BAUD, encode(0, 0, 1, "get system.serial")):
        try:
            reply = decode(line)
        except DamagedLineError:
            continue
        if reply is not None and reply.accepted:
            settings: dict[str, str | int] = {"port": url}
            if reply.address != 1:
                settings["address"] = reply.address
            found.append(Found(f"Zaber device {reply.address}, serial number {reply.data}", settings))
    return found


FINDER = Finder("Zaber stages", ports=serial_ports, at_port=zaber_stages, asks_for_s=ANSWER_S)
