"""Register maps: what stands where in a load frame's Modbus registers, as TOML data, and how to read it.

A map has blocks. Each block is read or written whole, in one request, so that its values belong together; its
registers follow each other without a gap. `drivers/maps/generic.toml` is the example.
"""

import contextlib
from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path
from typing import Any, Self

from pydantic import Field, ValidationError, model_validator

from drivers.errors import ConfigurationError
from drivers.registers import Block, Register, Unit, WordOrder
from drivers.settings import Settings, mistakes_in, read_toml

# What Modbus itself allows in one request.
READ_MAX, WRITE_MAX = 125, 123

# The registers the driver needs, and the unit of each.
NEEDED: dict[str, dict[str, Unit]] = {
    "state": {
        "revision": "", "sample": "", "status": "", "fault": "", "executed": "", "result": "",
        "load": "N", "displacement": "mm",
    },
    "identity": {"serial": "", "firmware": ""},
    "command": {
        "command": "", "displacement": "mm", "speed": "mm/s", "load": "N", "load_rate": "N/s", "sequence": "",
    },
    "limits": {
        "load_min": "N", "load_max": "N", "displacement_min": "mm", "displacement_max": "mm",
        "speed_max": "mm/s", "load_rate_max": "N/s",
    },
    "watchdog": {"timeout": "s"},
    "heartbeat": {"heartbeat": ""},
}  # fmt: skip
# Blocks a map may have besides, and the registers that stand there then, and in which block they stand else.
APART = {
    "status": ("state", ("status", "fault", "executed", "result")),
    "setpoints": ("command", ("displacement", "speed", "load", "load_rate")),
}
COUNTERS = {"sequence": ["u16"], "executed": ["u16"], "heartbeat": ["u16"], "sample": ["u16", "u32"]}
WRITTEN = ("command", "setpoints", "limits", "watchdog", "heartbeat")


class Blocks(Settings):
    """The blocks every map has, and two that some machines keep apart.

    Attributes
    ----------
    state, identity, command, limits, watchdog, heartbeat : Block
    status : Block, optional
        Where status word, fault and executed command do not stand beside load and displacement.
    setpoints : Block, optional
        Where targets and rates do not stand beside the command word; they are written and read back first.
    """

    state: Block
    identity: Block
    command: Block
    limits: Block
    watchdog: Block
    heartbeat: Block
    status: Block | None = None
    setpoints: Block | None = None


class Status(Settings):
    """Bits of the register `status`, from 0, the least significant."""

    moving: int = Field(ge=0, le=31)
    at_target: int = Field(ge=0, le=31)
    hold: int = Field(ge=0, le=31)
    load_valid: int = Field(ge=0, le=31)
    faults: dict[str, int]

    @model_validator(mode="after")
    def _distinct(self) -> Self:
        bits = [self.moving, self.at_target, self.hold, self.load_valid, *self.faults.values()]
        if len(set(bits)) < len(bits) or not all(0 <= bit <= 31 for bit in bits):
            raise ValueError("every bit must have a number of its own from 0 to 31")
        return self


class Commands(Settings):
    """Values of the register `command`."""

    hold: int = Field(ge=0, le=0xFFFF)
    go_to_displacement: int = Field(ge=0, le=0xFFFF)
    go_to_load: int = Field(ge=0, le=0xFFFF)
    tare: int = Field(ge=0, le=0xFFFF)

    @model_validator(mode="after")
    def _distinct(self) -> Self:
        values = [self.hold, self.go_to_displacement, self.go_to_load, self.tare]
        if len(set(values)) < len(values):
            raise ValueError("every command must have a value of its own")
        return self


class RegisterMap(Settings):
    """A load frame's registers.

    Attributes
    ----------
    vendor, model : str
    revision : int
        What the register `revision` must hold.
    word_order : str
        How the bytes A (most significant) to D of a 32-bit value stand in its two registers.
    request_max : int
        Most registers the device takes in one request.
    blocks, status, commands
    fault_codes, results : dict
        Meaning of the values of `fault` and `result`; 0 is always "none" and "accepted".
    """

    vendor: str
    model: str
    revision: int
    word_order: WordOrder
    request_max: int = Field(default=WRITE_MAX, ge=2, le=READ_MAX)
    blocks: Blocks
    status: Status
    commands: Commands
    fault_codes: dict[str, str]
    results: dict[str, str]


def shipped_maps() -> list[str]:
    """Names of the maps that come with the package."""
    return sorted(path.stem for path in (Path(__file__).parent / "maps").glob("*.toml"))


def load_map(name: str) -> RegisterMap:
    """Read a map by the name of a shipped one, or by path.

    Raises
    ------
    ConfigurationError
        If it cannot be read or has mistakes; all are reported together.
    """
    path = Path(__file__).parent / "maps" / f"{name}.toml" if name in shipped_maps() else Path(name)
    if not path.is_file():
        known = ", ".join(shipped_maps())
        raise ConfigurationError(
            f"register map {name!r}",
            [f"neither a file nor a shipped map ({known}); correct map of the load frame"],
        )
    return parse_map(read_toml(path), str(path))


def parse_map(data: Mapping[str, Any], source: str) -> RegisterMap:
    """Check a map's content; `source` names it in messages. Raises `ConfigurationError` like `load_map`."""
    mistakes: list[str] = []
    register_map = None
    needed = _needed(_tables(data.get("blocks")))
    try:
        register_map = RegisterMap.model_validate(data)
    except ValidationError as error:
        mistakes = mistakes_in(error)
    request_max = data.get("request_max", WRITE_MAX)
    blocks = {name: _Understood(name, block) for name, block in _tables(data.get("blocks")).items()}
    for block in blocks.values():
        mistakes += block.layout_mistakes() + block.use_mistakes(needed.get(block.name, {}))
        if isinstance(request_max, int) and block.count > request_max:
            mistakes.append(f"{block.where}: {block.count} registers, more than {request_max} in one request")
    mistakes += _collisions(list(blocks.values()))
    if register_map is None or mistakes:
        raise ConfigurationError(source, mistakes)
    return register_map


class _Understood:
    """What can be understood of a block as written: a mistake in one register does not hide others."""

    def __init__(self, name: str, raw: Mapping[str, Any]) -> None:
        self.name = name
        self.where = f"blocks.{name}"
        self.table = raw.get("table")
        self.single = raw.get("single") is True
        written = _tables(raw.get("registers"))
        self.names = set(written)
        self.placed: list[tuple[str, Register]] = []
        for register_name, register in written.items():
            with contextlib.suppress(ValidationError):
                self.placed.append((register_name, Register.model_validate(register)))
        self.placed.sort(key=lambda item: item[1].address)

    @property
    def start(self) -> int:
        return self.placed[0][1].address if self.placed else 0

    @property
    def end(self) -> int:
        return max((register.end for _, register in self.placed), default=0)

    @property
    def count(self) -> int:
        return self.end - self.start

    def layout_mistakes(self) -> list[str]:
        mistakes = []
        whole = len(self.placed) == len(self.names)
        for (name, register), (next_name, following) in pairwise(self.placed):
            if following.address < register.end:
                mistakes.append(
                    f"{self.where}: {next_name} at {following.address} overlaps {name}, to {register.end - 1}"
                )
            elif following.address > register.end and whole:
                mistakes.append(
                    f"{self.where}: {register.end} to {following.address - 1}, between {name} and "
                    f"{next_name}, are not declared; declare them or make two blocks"
                )
        if self.end > 0x10000:
            mistakes.append(f"{self.where}: ends beyond register 65535")
        return mistakes

    def use_mistakes(self, needed: Mapping[str, Unit]) -> list[str]:
        """What the driver needs of this block and does not find."""
        mistakes = [
            f"{self.where}.registers.{name}: is missing; add it" for name in needed if name not in self.names
        ]
        for name, register in self.placed:
            where = f"{self.where}.registers.{name}"
            unit = needed.get(name, register.unit)
            if register.unit != unit:
                mistakes.append(f"{where}.unit: must be {unit!r}, got {register.unit!r}; convert by scale")
            if name in COUNTERS and register.type not in COUNTERS[name]:
                mistakes.append(f"{where}.type: must be {' or '.join(COUNTERS[name])}, got {register.type!r}")
        if self.single and self.count != 1:
            mistakes.append(f"{self.where}.single: one register is expected, got {self.count}")
        if self.name in WRITTEN and self.table == "input":
            mistakes.append(f"{self.where}.table: must be 'holding', because it is written")
        return mistakes


def _needed(blocks: Mapping[str, object]) -> dict[str, dict[str, Unit]]:
    """Return the registers each block of a map must have, where some stand apart."""
    needed = {name: dict(registers) for name, registers in NEEDED.items()}
    for name, (home, registers) in APART.items():
        if name in blocks:
            needed[name] = {register: needed[home].pop(register) for register in registers}
    return needed


def _collisions(blocks: list[_Understood]) -> list[str]:
    mistakes = []
    for table in ("input", "holding"):
        placed = sorted((b for b in blocks if b.table == table), key=lambda b: b.start)
        for block, following in pairwise(placed):
            if following.start < block.end:
                mistakes.append(
                    f"{following.where}: {table} {following.start} overlaps {block.where}, to {block.end - 1}"
                )
    return mistakes


def _tables(value: object) -> dict[str, dict[str, Any]]:
    return {k: v for k, v in value.items() if isinstance(v, dict)} if isinstance(value, dict) else {}
