"""Register layouts of load frames: the address and the type of each value, as in the devices' manuals.

The drivers have their own register maps in TOML files. Simulators and drivers do not share register maps, so
a mistake in one of the two makes the tests fail.
"""

import math
import struct
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

Number = int | float

_FORMATS = {"u16": ">H", "i16": ">h", "u32": ">I", "i32": ">i", "f32": ">f"}
_ENCODINGS = {kind: struct.Struct(form) for kind, form in _FORMATS.items()}
_SIZES = {kind: encoding.size // 2 for kind, encoding in _ENCODINGS.items()}
WORD_ORDERS = {"ABCD": (0, 1, 2, 3), "CDAB": (2, 3, 0, 1), "BADC": (1, 0, 3, 2), "DCBA": (3, 2, 1, 0)}
NO_VALUE = 0x7FFFFFFF
"""The load reading in integer registers that means that the device cannot measure the load."""


@dataclass(frozen=True)
class SimulatedRegister:
    """A value in the Modbus registers: its name, its type, and the factor from the raw value to the unit."""

    name: str
    kind: str
    scale: float = 1.0

    @property
    def size(self) -> int:
        """Number of 16-bit registers that the value occupies."""
        return _SIZES[self.kind]


@dataclass(frozen=True)
class RegisterBlock:
    """Values at consecutive register addresses, and the address of the first value."""

    address: int
    registers: tuple[SimulatedRegister, ...]

    @cached_property
    def count(self) -> int:
        """Number of 16-bit registers in the block."""
        return sum(register.size for register in self.registers)


@dataclass(frozen=True)
class RegisterLayout:
    """All registers of one device.

    Attributes
    ----------
    state, identity : RegisterBlock
        Read-only blocks.
    status : RegisterBlock, optional
        Read-only block of the status word; None if the status word is part of `state`.
    command, limits, watchdog, heartbeat : RegisterBlock
        Blocks that a client writes completely, each in one request.
    setpoints : RegisterBlock, optional
        Block of targets and rates, which a client writes before the command. None if `command` contains these
        values.
    bits : mapping of str to int
        Bit number of each status, such as ``moving``, in the status word.
    commands : mapping of int to str
        The commands ``hold``, ``displacement``, ``load``, ``speed`` and ``tare`` by their codes.
    word_order : str
        Order of the bytes A (most significant) to D of a 32-bit value in two registers.
    request_max : int
        Largest number of registers in one request.
    one_table : bool
        True if read-only values are also holding registers, because the device has no input registers.
    """

    state: RegisterBlock
    identity: RegisterBlock
    command: RegisterBlock
    limits: RegisterBlock
    watchdog: RegisterBlock
    heartbeat: RegisterBlock
    bits: Mapping[str, int]
    commands: Mapping[int, str]
    status: RegisterBlock | None = None
    setpoints: RegisterBlock | None = None
    word_order: str = "ABCD"
    request_max: int = 125
    one_table: bool = False

    @property
    def readable(self) -> list[RegisterBlock]:
        """The read-only blocks of the layout."""
        return [block for block in (self.state, self.status, self.identity) if block is not None]

    @property
    def writable(self) -> list[RegisterBlock]:
        """The blocks that a client can write and read back."""
        blocks = (self.command, self.setpoints, self.limits, self.watchdog, self.heartbeat)
        return [block for block in blocks if block is not None]

    def encode(self, block: RegisterBlock, values: Mapping[str, Number]) -> bytes:
        """Return the bytes of a block; values that are missing in `values` are 0."""
        return b"".join(self._encode(each, values.get(each.name, 0)) for each in block.registers)

    def decode(self, block: RegisterBlock, data: bytes) -> dict[str, Number]:
        """Decode the bytes of all registers of a block, and return the values by name."""
        values: dict[str, Number] = {}
        place = 0
        for register in block.registers:
            raw = self._ordered(data[place : place + 2 * register.size])
            (number,) = _ENCODINGS[register.kind].unpack(raw)
            values[register.name] = number if register.scale == 1.0 else number * register.scale
            place += 2 * register.size
        return values

    def _encode(self, register: SimulatedRegister, value: Number) -> bytes:
        if register.kind == "f32":
            return self._ordered(_ENCODINGS["f32"].pack(value / register.scale))
        raw = round(value / register.scale) if math.isfinite(value) else NO_VALUE
        bits = 16 * register.size
        if register.kind.startswith("u"):
            raw %= 2**bits  # counters restart at 0 after their highest value
        else:
            raw = min(max(raw, -(2 ** (bits - 1))), 2 ** (bits - 1) - 1)
        return self._ordered(_ENCODINGS[register.kind].pack(raw))

    def _ordered(self, data: bytes) -> bytes:
        """Reorder four bytes to the device's order or back; the same reordering works in both directions."""
        if len(data) == 2 or self.word_order == "ABCD":
            return data
        return bytes(data[i] for i in WORD_ORDERS[self.word_order])


def _block(address: int, **kinds: str | tuple[str, float]) -> RegisterBlock:
    """Make a block from the names of its registers in order, each with its type, or its type and scale."""
    return RegisterBlock(
        address,
        tuple(
            SimulatedRegister(name, *((kind,) if isinstance(kind, str) else kind))
            for name, kind in kinds.items()
        ),
    )


_LIMITS_F32 = _block(
    32,
    load_min="f32", load_max="f32", displacement_min="f32", displacement_max="f32", speed_max="f32",
    load_rate_max="f32",
)  # fmt: skip

GENERIC = RegisterLayout(
    state=_block(
        0,
        revision="u16", sample="u32", status="u16", fault="u16", executed="u16", result="u16", spare="u16",
        load="f32", displacement="f32", speed="f32", target="f32", device_time_ms="u32", set_speed="f32",
    ),
    identity=_block(32, serial="u32", firmware="u16"),
    command=_block(
        0, command="u16", displacement="f32", speed="f32", load="f32", load_rate="f32", sequence="u16"
    ),
    limits=_LIMITS_F32,
    watchdog=_block(64, timeout="f32"),
    heartbeat=_block(66, heartbeat="u16"),
    bits={
        "ready": 0, "moving": 1, "at_target": 2, "holding": 3, "limit": 4, "watchdog": 5, "estop": 6,
        "load_valid": 7,
    },
    commands={1: "hold", 2: "displacement", 3: "load", 4: "tare", 5: "speed"},
)  # fmt: skip
"""A simple layout: values in N, mm and s as 32-bit floats, and the device time in ms."""

# Values in units of 0.1 N and 0.1 µm, as i32 or u32.
_NEWTONS, _MILLIMETRES, _N_S, _MM_S = ("i32", 0.1), ("i32", 1e-4), ("u32", 0.1), ("u32", 1e-4)

SCALED_INTEGERS = RegisterLayout(
    state=_block(
        256,
        revision="u16", status="u16", sample="u32", fault="u16", executed="u16", result="u16", spare="u16",
        load=_NEWTONS, displacement=_MILLIMETRES, set_speed=_MM_S,
    ),
    identity=_block(288, serial="u32", firmware="u16"),
    command=_block(
        512,
        command="u16", displacement=_MILLIMETRES, speed=_MM_S, load=_NEWTONS, load_rate=_N_S, sequence="u16",
    ),
    limits=_block(
        544,
        load_min=_NEWTONS, load_max=_NEWTONS, displacement_min=_MILLIMETRES, displacement_max=_MILLIMETRES,
        speed_max=_MM_S, load_rate_max=_N_S,
    ),
    watchdog=_block(576, timeout=("u16", 0.001)),
    heartbeat=_block(577, heartbeat="u16"),
    bits={"moving": 0, "at_target": 1, "holding": 2, "watchdog": 4, "estop": 5, "load_valid": 8},
    commands={1: "hold", 2: "displacement", 3: "load", 4: "tare", 5: "speed"},
    word_order="CDAB",
    request_max=16,
    one_table=True,
)  # fmt: skip
"""A layout with scaled integers, low word first, at most 16 registers per request, and one table."""

SEPARATE_WORDS = RegisterLayout(
    state=_block(0, revision="u16", sample="u16", load="f32", displacement="f32"),
    status=_block(16, status="u16", fault="u16", executed="u16", result="u16"),
    identity=_block(32, serial="u32", firmware="u16"),
    setpoints=_block(0, displacement="f32", speed="f32", load="f32", load_rate="f32"),
    command=_block(16, command="u16", sequence="u16"),
    limits=_LIMITS_F32,
    watchdog=_block(64, timeout="f32"),
    heartbeat=_block(66, heartbeat="u16"),
    bits={"load_valid": 0, "moving": 8, "at_target": 9, "holding": 10, "watchdog": 12, "estop": 13},
    commands={0x0100: "hold", 0x0201: "displacement", 0x0202: "load", 0x0203: "speed", 0x0400: "tare"},
)
"""A layout in which the command word and the status word have blocks of their own."""

LAYOUTS = {"generic": GENERIC, "scaled-integers": SCALED_INTEGERS, "separate-words": SEPARATE_WORDS}
"""All layouts. Each layout has the same name as the drivers' register map for that device."""
