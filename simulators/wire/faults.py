"""Faults of simulated devices by name, switched on and off while the device runs.

A fault is written ``NAME[:VALUE][:COUNT]``, such as ``drop``, ``drop:2`` (the next two messages only),
``delay:0.2`` or ``delay:0.2:1``; a value is there only for faults that have one.
"""

import threading
from collections.abc import Callable
from dataclasses import dataclass

STAGE, NEWPORT, LOAD_FRAME, CAMERA = "stage", "newport", "load_frame", "camera"
LINES = (STAGE, NEWPORT, LOAD_FRAME)
DEVICES = (*LINES, CAMERA)


@dataclass(frozen=True)
class Fault:
    """One thing that can go wrong.

    Attributes
    ----------
    name : str
    summary : str
        What happens while it is on.
    devices : tuple of str
        The kinds of device that can have it.
    value : str
        What its value means; empty when it has none.
    default : str
        The value when none is given.
    counted : bool
        Whether the fault strikes single messages and can be limited to a number of them. Other faults stay on
        until they are cleared.
    lowest, highest : int
        Bounds of a numeric value.
    """

    name: str
    summary: str
    devices: tuple[str, ...]
    value: str = ""
    default: str = ""
    counted: bool = False
    lowest: int = 0
    highest: int = 0

    @property
    def usage(self) -> str:
        """How the fault is written."""
        value = f"[:{self.value}]" if self.value else ""
        return self.name + value + ("[:COUNT]" if self.counted else "")


FAULTS = {
    fault.name: fault
    for fault in (
        Fault("lose-request", "the message never reaches the device", LINES, counted=True),
        Fault("drop", "the device acts, but its answer is lost", DEVICES, counted=True),
        Fault("corrupt", "the answer arrives damaged", DEVICES, counted=True),
        Fault("split", "the answer arrives in pieces", LINES, counted=True),
        Fault("delay", "the answer comes so much later", DEVICES, "SECONDS", "0.02", True, 0, 3600),
        Fault("duplicate", "the answer arrives twice", LINES, counted=True),
        Fault("late", "the answer arrives only when the next message was sent", LINES, counted=True),
        Fault("stale", "what comes is older than what was asked for", DEVICES, counted=True),
        Fault("wrong-unit", "the answer bears another device's address", (STAGE, LOAD_FRAME), counted=True),
        Fault(
            "exception",
            "the device answers with a Modbus exception",
            (LOAD_FRAME,),
            "CODE",
            "6",
            counted=True,
            lowest=1,
            highest=255,
        ),
        Fault("reject", "the device refuses the message", (STAGE,), "REASON", "STATUSBUSY", counted=True),
        Fault(
            "error",
            "the command is not executed, and the device keeps an error code",
            (NEWPORT,),
            "CODE",
            "115",
            counted=True,
            lowest=1,
            highest=999,
        ),
        Fault("unplug", "the cable is out", DEVICES),
        Fault("reset", "the device is switched off and on, in motion or not", LINES),
        Fault("stall", "the drive stalls: nothing moves, or no frame comes", DEVICES),
        Fault("limit", "a limit switch trips", LINES),
        Fault("e-stop", "the emergency stop is pressed", LINES),
        Fault("nan-load", "the load cell is broken: the load is no number", (LOAD_FRAME,)),
        Fault("frozen-counter", "the readings and their counter stand still", (LOAD_FRAME,)),
        Fault("broken-specimen", "the specimen breaks, for good", (LOAD_FRAME,)),
        Fault("watchdog-off", "the machine's watchdog is off and takes no time", (LOAD_FRAME,)),
    )
}


class FaultPanel:
    """The faults of one device; any thread may switch them.

    Parameters
    ----------
    device : str
        ``stage``, ``newport``, ``load_frame`` or ``camera``.
    """

    def __init__(self, device: str) -> None:
        self.device = device
        self._lock = threading.Lock()
        # switching is carried out in the order in which it was asked for
        self._switching = threading.RLock()
        self._on: dict[str, tuple[str, int | None]] = {}
        self._effects: dict[str, list[tuple[Callable[[], None], Callable[[], None] | None]]] = {}

    def when(self, name: str, on: Callable[[], None], off: Callable[[], None] | None = None) -> None:
        """Register what happens when a fault is switched on, and when it is cleared.

        Without `off` the fault is a single event: each time it is switched on, it happens once.
        """
        self._effects.setdefault(name, []).append((on, off))

    def switch_on(self, text: str) -> None:
        """Switch a fault on, written as ``NAME[:VALUE][:COUNT]``.

        Raises
        ------
        ValueError
            If there is no such fault, this device cannot have it, or it is written wrongly.
        """
        fault, value, count = parse(text)
        if self.device not in fault.devices:
            raise ValueError(
                f"fault {fault.name!r}: expected one that {self.device} can have "
                f"({', '.join(names(self.device))}), got one of {', '.join(fault.devices)}"
            )
        with self._switching:
            fresh = fault.name not in self.active
            with self._lock:
                self._on[fault.name] = (value, count)
            for on, off in self._effects.get(fault.name, ()):
                if fresh or off is None:
                    on()

    def clear(self, name: str = "") -> None:
        """Switch one fault off, or all of them; harmless when it is not on.

        Raises
        ------
        OSError
            If another program has taken an unplugged port meanwhile; the fault stays on.
        """
        with self._switching:
            for each in self.active:
                if name not in ("", each):
                    continue
                for _, off in self._effects.get(each, ()):
                    if off is not None:
                        off()
                with self._lock:
                    self._on.pop(each, None)

    @property
    def active(self) -> list[str]:
        """The names of the faults that are on."""
        with self._lock:
            return list(self._on)

    def take(self, name: str) -> str | None:
        """Return the value of a fault if it strikes now, else None; a counted fault loses one count."""
        with self._lock:
            if name not in self._on:
                return None
            value, count = self._on[name]
            if count == 1:
                del self._on[name]
            elif count is not None:
                self._on[name] = (value, count - 1)
            return value


def names(device: str) -> list[str]:
    """Return the names of the faults a kind of device can have."""
    return [name for name, fault in FAULTS.items() if device in fault.devices]


def parse(text: str) -> tuple[Fault, str, int | None]:
    """Read ``NAME[:VALUE][:COUNT]``; ValueError says what is wrong with it."""
    name, *rest = text.strip().split(":")
    fault = FAULTS.get(name)
    if fault is None:
        raise ValueError(f"fault {name!r}: expected one of {', '.join(FAULTS)}")
    value = (rest.pop(0) if rest else fault.default) if fault.value else ""
    count = rest.pop(0) if rest and fault.counted else None
    if rest or (count is not None and not (_is_number(count) and int(count) > 0)):
        raise ValueError(f"fault {text!r}: expected {fault.usage}")
    _require_value(fault, value, text)
    return fault, value, None if count is None else int(count)


def _require_value(fault: Fault, value: str, text: str) -> None:
    if not fault.value:
        return
    if fault.highest:
        wanted = f"a number from {fault.lowest} to {fault.highest}"
        digits = value.replace(".", "", 1) if fault.value == "SECONDS" else value
        good = _is_number(digits) and fault.lowest <= float(value) <= fault.highest
    else:
        wanted, good = "one word of letters", value.isascii() and value.isalpha()
    if not good:
        raise ValueError(f"fault {text!r}: expected {fault.usage} with {wanted}, got {value!r}")


def _is_number(text: str) -> bool:
    return text.isascii() and text.isdecimal() and len(text) < 10
