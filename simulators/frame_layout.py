"""Where a load frame keeps what in its registers, written down from the devices' own manuals.

This is the simulators' side of a register map. The drivers have theirs, as TOML; neither reads the other, so
that a mistake in one shows.
"""

import math
import struct
from collections.abc import Mapping
from dataclasses import dataclass, field

Number = int | float

_FORMATS = {"u16": ">H", "i16": ">h", "u32": ">I", "i32": ">i", "f32": ">f"}
_RANGES = {
    "u16": (0, 2**16 - 1),
    "i16": (-(2**15), 2**15 - 1),
    "u32": (0, 2**32 - 1),
    "i32": (-(2**31), 2**31 - 1),
}
WORD_ORDERS = {"ABCD": (0, 1, 2, 3), "CDAB": (2, 3, 0, 1), "BADC": (1, 0, 3, 2), "DCBA": (3, 2, 1, 0)}
NO_VALUE = 0x7FFFFFFF
"""What a device whose registers hold whole numbers shows for a load it cannot measure."""


@dataclass(frozen=True)
class Register:
    """One value: its name, its type, and what the raw value is multiplied with."""

    name: str
    kind: str
    scale: float = 1.0

    @property
    def size(self) -> int:
        """Number of 16-bit registers."""
        return struct.calcsize(_FORMATS[self.kind]) // 2


@dataclass(frozen=True)
class Block:
    """Values that lie one after the other."""

    address: int
    registers: tuple[Register, ...]

    @property
    def count(self) -> int:
        """Number of 16-bit registers."""
        return sum(register.size for register in self.registers)


@dataclass(frozen=True)
class Layout:
    """All registers of one device.

    Attributes
    ----------
    revision : int
    state, identity : Block
        Read-only, in the table of input registers unless `one_table`.
    command, limits, watchdog, heartbeat : Block
        Holding registers; each is written whole, in one request.
    word_order : str
        How the bytes A (most significant) to D of a 32-bit value stand in two registers.
    request_max : int
        Most registers in one request.
    one_table : bool
        Whether the device has holding registers only.
    status : tuple of str
        What the bits of the status mean, from 0; empty for a bit that means nothing.
    commands : mapping of int to str
        ``hold``, ``displacement``, ``load`` and ``tare`` by their codes.
    """

    revision: int
    state: Block
    identity: Block
    command: Block
    limits: Block
    watchdog: Block
    heartbeat: Block
    word_order: str = "ABCD"
    request_max: int = 125
    one_table: bool = False
    status: tuple[str, ...] = (
        "ready", "moving", "at_target", "holding", "limit", "watchdog", "estop", "load_valid",
    )  # fmt: skip
    commands: Mapping[int, str] = field(
        default_factory=lambda: {1: "hold", 2: "displacement", 3: "load", 4: "tare"}
    )

    def encode(self, block: Block, values: Mapping[str, Number]) -> bytes:
        """Return a block's bytes; values that are not named are 0."""
        return b"".join(self._encode(each, values.get(each.name, 0)) for each in block.registers)

    def decode(self, block: Block, data: bytes) -> dict[str, Number]:
        """Return a block's values from all its bytes."""
        values: dict[str, Number] = {}
        place = 0
        for register in block.registers:
            raw = self._ordered(data[place : place + 2 * register.size])
            (number,) = struct.unpack(_FORMATS[register.kind], raw)
            values[register.name] = number if register.scale == 1.0 else number * register.scale
            place += 2 * register.size
        return values

    def _encode(self, register: Register, value: Number) -> bytes:
        if register.kind == "f32":
            return self._ordered(struct.pack(">f", value / register.scale))
        if not math.isfinite(value):
            raw = NO_VALUE
        else:
            low, high = _RANGES[register.kind]
            raw = min(max(round(value / register.scale), low), high)
        return self._ordered(struct.pack(_FORMATS[register.kind], raw))

    def _ordered(self, data: bytes) -> bytes:
        """Bring four bytes into the device's order, or back: every order is its own inverse."""
        return data if len(data) == 2 else bytes(data[i] for i in WORD_ORDERS[self.word_order])


def _block(address: int, **kinds: str) -> Block:
    return Block(address, tuple(Register(name, kind) for name, kind in kinds.items()))


GENERIC = Layout(
    revision=1,
    state=_block(
        0,
        revision="u16", sample="u32", status="u16", fault="u16", executed="u16", result="u16", spare="u16",
        load="f32", displacement="f32", speed="f32", target="f32", device_time_ms="u32",
    ),
    identity=_block(32, serial="u32", firmware="u16"),
    command=_block(
        0, command="u16", displacement="f32", speed="f32", load="f32", load_rate="f32", sequence="u16"
    ),
    limits=_block(
        32,
        load_min="f32", load_max="f32", displacement_min="f32", displacement_max="f32", speed_max="f32",
        load_rate_max="f32",
    ),
    watchdog=_block(64, timeout="f32"),
    heartbeat=_block(66, heartbeat="u16"),
)  # fmt: skip
"""The tensile frame as it should be: N, mm and s as 32-bit floats, time in ms."""

LAYOUTS = {"generic": GENERIC}
"""By the name of the drivers' map that describes the same device."""
