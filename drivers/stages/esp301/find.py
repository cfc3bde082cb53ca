"""Find the Newport controller at a serial port. Every model answers the question for its version."""

from drivers.lines.serial_ports import ANSWER_S, lines_answered, serial_ports
from drivers.registry import Finder, Found
from drivers.stages.esp301.protocol import END, MODEL

BAUDS = (921_600, 19_200)


def newport_stages(url: str) -> list[Found]:
    """Return the Newport controller at a serial port or behind ``socket://host:port``.

    Raise `OSError` if the port cannot be opened or used.
    """
    for baud in BAUDS:
        for line in lines_answered(url, baud, b"VE?" + END):
            match = MODEL.fullmatch(line.decode("ascii", "replace"))
            if match is not None:
                what = f"Newport {match['model']}, firmware {match['firmware']}"
                return [Found(what, {"port": url, "baud": baud})]
    return []


FINDER = Finder(
    "Newport stages", ports=serial_ports, at_port=newport_stages, asks_for_s=len(BAUDS) * ANSWER_S
)
