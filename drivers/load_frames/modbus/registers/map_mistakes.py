"""Check a register map as a whole: its addresses, its sizes, and the presence of all needed registers."""

import contextlib
from collections.abc import Mapping
from itertools import pairwise
from typing import Any

from pydantic import ValidationError

from drivers.load_frames.modbus.registers.registers import Register, Unit

# Largest numbers of registers that Modbus allows in one read request and in one write request.
READ_MAX, WRITE_MAX = 125, 123

# The registers that the driver needs in each block, and the unit of each register.
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
# The unit of a register that a block may have, and that the driver uses then.
OPTIONAL: dict[str, Unit] = {"set_speed": "mm/s"}
# The registers of each optional block, and the mandatory block that has these registers in a map without the
# optional block.
APART = {
    "status": ("state", ("status", "fault", "executed", "result")),
    "setpoints": ("command", ("displacement", "speed", "load", "load_rate")),
}
# Registers without a unit hold unscaled whole numbers. These registers must have one of these types.
UNSIGNED = ["u16", "u32"]
TYPES = {
    "sequence": ["u16"], "executed": ["u16"], "heartbeat": ["u16"], "command": ["u16"],
    "sample": UNSIGNED, "status": UNSIGNED, "fault": UNSIGNED, "result": UNSIGNED,
}  # fmt: skip
WHOLE = [*UNSIGNED, "i16", "i32"]
WRITTEN = ("command", "setpoints", "limits", "watchdog", "heartbeat")


def mistakes_across(data: Mapping[str, Any]) -> list[str]:
    """Return the mistakes that concern several parts of a register map, one sentence per mistake.

    `data` is the register map as read from TOML, not yet validated.
    """
    tables = _tables(data.get("blocks"))
    needed = _needed(tables)
    blocks = {name: _Understood(name, block) for name, block in tables.items()}
    mistakes: list[str] = []
    for block in blocks.values():
        mistakes += block.layout_mistakes() + block.use_mistakes(needed.get(block.name, {}))
        mistakes += block.size_mistakes(data.get("request_max", READ_MAX))
    return (
        mistakes + _collisions(list(blocks.values())) + _bit_mistakes(blocks, _tables(data).get("status", {}))
    )


class _Understood:
    """The valid registers of a block. Invalid ones are left out, so that other mistakes are still found."""

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

    def size_mistakes(self, request_max: object) -> list[str]:
        most = min(request_max if isinstance(request_max, int) else READ_MAX, READ_MAX)
        if self.name in WRITTEN:
            most = min(most, WRITE_MAX)
        if self.count <= most:
            return []
        return [f"{self.where}: {self.count} registers, more than {most} in one request"]

    def use_mistakes(self, needed: Mapping[str, Unit]) -> list[str]:
        """Return the mistakes in the registers of this block. `needed` lists the required registers."""
        mistakes = [
            f"{self.where}.registers.{name}: is missing; add it" for name in needed if name not in self.names
        ]
        for name, register in self.placed:
            where = f"{self.where}.registers.{name}"
            optional = OPTIONAL if self.name in ("state", "status") else {}
            unit = needed.get(name, optional.get(name, register.unit))
            if register.unit != unit:
                mistakes.append(f"{where}.unit: must be {unit!r}, got {register.unit!r}; convert by scale")
            if unit or name not in needed:
                continue
            types = TYPES.get(name, WHOLE)
            if register.type not in types:
                mistakes.append(f"{where}.type: must be {' or '.join(types)}, got {register.type!r}")
            if register.scale != 1.0:
                mistakes.append(f"{where}.scale: must be 1, got {register.scale:g}")
        if self.single and self.count != 1:
            mistakes.append(f"{self.where}.single: one register is expected, got {self.count}")
        if self.name in WRITTEN and self.table == "input":
            mistakes.append(f"{self.where}.table: must be 'holding', because it is written")
        return mistakes


def _needed(blocks: Mapping[str, object]) -> dict[str, dict[str, Unit]]:
    """Return the registers that each block must have, which depends on the optional blocks of the map."""
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


def _bit_mistakes(blocks: Mapping[str, _Understood], status: Mapping[str, Any]) -> list[str]:
    """Return a mistake for each bit number that is too large for the status register."""
    home = blocks.get("status", blocks.get("state"))
    width = (
        next((16 * register.size for name, register in home.placed if name == "status"), 32) if home else 32
    )
    bits = {f"status.{name}": bit for name, bit in status.items()}
    bits |= {f"status.faults.{name}": bit for name, bit in _tables(status).get("faults", {}).items()}
    return [
        f"{where}: the register has bits 0 to {width - 1}, got {bit}"
        for where, bit in bits.items()
        if isinstance(bit, int) and width <= bit <= 31
    ]


def _tables(value: object) -> dict[str, dict[str, Any]]:
    return {k: v for k, v in value.items() if isinstance(v, dict)} if isinstance(value, dict) else {}
