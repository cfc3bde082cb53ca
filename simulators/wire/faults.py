"""Faults of simulated devices by name, switched on and off while the device runs.

The text of a fault is ``NAME[:VALUE][:COUNT]``, such as ``drop``, ``drop:2`` (only for the next two
messages), ``delay:0.2`` or ``delay:0.2:1``. Some faults have no value.
"""

import threading
from collections.abc import Callable
from dataclasses import dataclass

STAGE, NEWPORT, LOAD_FRAME, CAMERA = "stage", "newport", "load_frame", "camera"
INTERLOCK, CLOSED_MACHINE, INSTRUMENT, MQTT = "interlock", "closed_machine", "instrument", "mqtt"
MACHINES = (STAGE, NEWPORT, LOAD_FRAME)
LINES = (*MACHINES, INTERLOCK, CLOSED_MACHINE, INSTRUMENT)
DAQ = "daq"
"""A device that samples by its own clock; the tests imitate its library."""
NOT_IN_RIG = (INSTRUMENT, MQTT, DAQ)
"""Devices that are simulated alone, and are not part of the virtual rig."""
DEVICES = (*LINES, CAMERA, DAQ, MQTT)
PICTURE = "picture"
"""Device name of faults in the pictures of all cameras, such as blur. Drivers cannot notice them."""


@dataclass(frozen=True)
class Fault:
    """The description of one fault.

    Attributes
    ----------
    name : str
    summary : str
        The effect of the fault.
    devices : tuple of str
        The kinds of devices that can have the fault.
    value : str
        The meaning of the fault's value, such as ``SECONDS``; empty for a fault without a value.
    default : str
        The value if the text of the fault contains no value.
    counted : bool
        True if the fault affects single messages and can be limited to a number of messages. Other faults
        stay on until they are cleared.
    lowest, highest : int
        Lowest and highest allowed value of a fault with a numeric value.
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
        """The syntax of the fault's text, such as ``delay[:SECONDS][:COUNT]``."""
        value = f"[:{self.value}]" if self.value else ""
        return self.name + value + ("[:COUNT]" if self.counted else "")


FAULTS = {
    fault.name: fault
    for fault in (
        Fault("lose-request", "the message never reaches the device", LINES, counted=True),
        Fault("drop", "the device acts, but its answer is lost", DEVICES, counted=True),
        Fault("corrupt", "the answer arrives damaged", (*LINES, CAMERA, MQTT), counted=True),
        Fault("split", "the answer arrives in pieces", LINES, counted=True),
        Fault("delay", "the answer comes SECONDS later", DEVICES, "SECONDS", "0.02", True, 0, 3600),
        Fault("duplicate", "the answer arrives twice", (*LINES, MQTT), counted=True),
        Fault("late", "the answer arrives only after the next message", LINES, counted=True),
        Fault("stale", "the previous answer or frame comes again", (*LINES, CAMERA, MQTT), counted=True),
        Fault(
            "wrong-unit",
            "the answer has another device's address",
            (STAGE, LOAD_FRAME, INTERLOCK, CLOSED_MACHINE),
            counted=True,
        ),
        Fault(
            "exception",
            "the device answers with a Modbus exception",
            (LOAD_FRAME, INTERLOCK, CLOSED_MACHINE),
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
        Fault("unplug", "the cable is unplugged", DEVICES),
        Fault("reset", "the device is switched off and on, even in motion", MACHINES),
        Fault("stall", "the drive stalls, or the device gives no frame or sample", (*MACHINES, CAMERA, DAQ)),
        Fault("limit", "a limit switch trips", MACHINES),
        Fault("e-stop", "the emergency stop is pressed", MACHINES),
        Fault("nan-load", "the load cell is broken, and the load is NaN", (LOAD_FRAME,)),
        Fault("zero-load", "the load cell shows no load, also to the controller", (LOAD_FRAME,)),
        Fault("tenth-load", "the load cell shows a tenth, also to the controller", (LOAD_FRAME,)),
        Fault("reversed-load", "the load cell shows the wrong sign, also to the controller", (LOAD_FRAME,)),
        Fault("stuck-load", "the load reading does not change, also for the controller", (LOAD_FRAME,)),
        Fault(
            "drifting-load",
            "the load cell shows N_S newtons less in each second, also to the controller",
            (LOAD_FRAME,),
            "N_S",
            "50",
            lowest=1,
            highest=100_000,
        ),
        Fault("frozen-counter", "the readings and their counter do not change", (LOAD_FRAME,)),
        Fault(
            "stuck-speed", "a change of speed is confirmed, but the crosshead keeps its speed", (LOAD_FRAME,)
        ),
        Fault("wrong-speed", "a change of speed takes half of the commanded speed", (LOAD_FRAME,)),
        Fault("broken-specimen", "the specimen breaks and stays broken", (LOAD_FRAME,)),
        Fault("broken-sensor", "the box has no value of its inputs", (CLOSED_MACHINE,)),
        Fault("overflow", "the amplifiers of the machine's outputs are at their end", (CLOSED_MACHINE,)),
        Fault("frozen", "the picture of the frame before comes as a new frame", (PICTURE,), counted=True),
        Fault("light", "the light is PERCENT of what it was", (PICTURE,), "PERCENT", "50", True, 0, 10000),
        Fault("defocus", "the lens is out of focus by PIXELS", (PICTURE,), "PIXELS", "4", True, 0, 100),
        Fault("blur", "the specimen moves by PIXELS along x", (PICTURE,), "PIXELS", "8", True, 0, 1000),
        Fault("glare", "a reflection grows by PX_S px per second", (PICTURE,), "PX_S", "50", False, 0, 10000),
        Fault("cover", "the lens is covered within SECONDS", (PICTURE,), "SECONDS", "0", False, 0, 3600),
        Fault(
            "tear",
            "the pattern tears, by UM_S µm per second",
            (PICTURE,),
            "UM_S",
            "50",
            False,
            1,
            10**6,
        ),
        Fault(
            "creep",
            "a camera creeps by UM_S µm per second",
            (PICTURE,),
            "UM_S",
            "10",
            False,
            1,
            10**6,
        ),
        Fault(
            "roll",
            "a camera turns by MDEG_S mdeg per second",
            (PICTURE,),
            "MDEG_S",
            "10",
            False,
            1,
            10**6,
        ),
        Fault(
            "flicker", "the lamps flicker at 100 Hz by PERCENT", (PICTURE,), "PERCENT", "20", False, 0, 100
        ),
        Fault("dropout", "a camera is gone for SECONDS", (PICTURE,), "SECONDS", "5", True, 0, 3600),
        Fault("watchdog-off", "the machine's watchdog is off and stays off", (LOAD_FRAME,)),
    )
}


class FaultPanel:
    """The faults of one device. Any thread may switch faults on and off.

    Parameters
    ----------
    device : str
        ``stage``, ``newport``, ``load_frame``, ``interlock``, ``closed_machine``, ``camera`` or ``picture``.
    """

    def __init__(self, device: str) -> None:
        self.device = device
        self._lock = threading.Lock()
        # With this lock, only one thread at a time switches a fault.
        self._switching = threading.RLock()
        self._on: dict[str, tuple[str, int | None]] = {}
        self._effects: dict[str, list[tuple[Callable[[], None], Callable[[], None] | None]]] = {}

    def when(self, name: str, on: Callable[[], None], off: Callable[[], None] | None = None) -> None:
        """Register functions that are called when a fault is switched on and when the fault is cleared.

        A fault without `off` is a single event, which happens once each time the fault is switched on.
        """
        self._effects.setdefault(name, []).append((on, off))

    def switch_on(self, text: str) -> None:
        """Switch on the fault with the text ``NAME[:VALUE][:COUNT]``.

        Raises
        ------
        ValueError
            If the fault does not exist, this device cannot have the fault, or the text is malformed.
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
        """Switch off the fault `name`, or all faults without a name. A fault that is off stays off.

        Raises
        ------
        OSError
            If another program now uses the port of an unplugged device. The fault then stays on.
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
        """Return the value of a fault that is on, otherwise None.

        If the fault has a count, the count decreases by one message.
        """
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
    """Return the names of the faults that a kind of device can have."""
    return [name for name, fault in FAULTS.items() if device in fault.devices]


def parse(text: str) -> tuple[Fault, str, int | None]:
    """Read the text ``NAME[:VALUE][:COUNT]`` of a fault; raise `ValueError` for a malformed text."""
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
