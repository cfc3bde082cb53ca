"""Read register maps: TOML files that describe the Modbus registers of a load frame.

A register map has blocks. Each block is read or written as a whole in one request, so that its values belong
to the same moment. The registers of a block have no gaps between them. The file
`drivers/load_frames/modbus/maps/generic.toml` is an example.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Self

from pydantic import Field, ValidationError, field_validator, model_validator

from drivers.errors import ConfigurationError
from drivers.load_frames.modbus.registers.map_mistakes import READ_MAX, mistakes_across
from drivers.load_frames.modbus.registers.registers import Block, WordOrder
from drivers.settings import Settings, mistakes_in, read_toml


class Blocks(Settings):
    """The six blocks that every register map must have, and two optional blocks."""

    state: Block
    identity: Block
    command: Block
    limits: Block
    watchdog: Block
    heartbeat: Block
    # block with the status word, the fault, and the number and the result of the executed command. It is left
    # out if the block `state` has these registers.
    status: Block | None = None
    # block with targets and rates. It is left out if the block `command` has these registers. Before a
    # command with a target, the driver reads the block `setpoints`. If the values differ, it writes the block
    # and reads it back.
    setpoints: Block | None = None


class StatusBits(Settings):
    """Numbers of the bits in the register `status`; bit 0 is the least significant bit."""

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
    """Values that the driver writes to the register `command`, one value per command."""

    hold: int = Field(ge=0, le=0xFFFF)
    go_to_displacement: int = Field(ge=0, le=0xFFFF)
    go_to_load: int = Field(ge=0, le=0xFFFF)
    tare: int = Field(ge=0, le=0xFFFF)
    # changes the speed of the present motion to a displacement. The machine must refuse the command without
    # such a motion, so a second `go_to_displacement` is no substitute. Without the command, the key is left
    # out.
    change_speed: int | None = Field(default=None, ge=0, le=0xFFFF)

    @model_validator(mode="after")
    def _distinct(self) -> Self:
        values = [self.hold, self.go_to_displacement, self.go_to_load, self.tare]
        values += [] if self.change_speed is None else [self.change_speed]
        if len(set(values)) < len(values):
            raise ValueError("every command must have a value of its own")
        return self


class RegisterMap(Settings):
    """Description of the registers of a load frame."""

    vendor: str
    model: str
    revision: int  # value that the register `revision` of the machine must have
    # order of the four bytes of a 32-bit value in its two registers; A is the most significant byte
    word_order: WordOrder
    # largest number of registers that the device accepts in one request
    request_max: int = Field(default=READ_MAX, ge=2, le=READ_MAX)
    blocks: Blocks
    status: StatusBits
    commands: Commands
    # meanings of the values of the registers `fault` and `result`. The value 0 always means "no fault" and
    # "accepted".
    fault_codes: dict[str, str]
    results: dict[str, str]

    @field_validator("fault_codes", "results")
    @classmethod
    def _numbered(cls, meanings: dict[str, str]) -> dict[str, str]:
        for number in meanings:
            if not (number.isascii() and number.isdecimal()) or number.startswith("0"):
                raise ValueError(f"a decimal number above 0 is expected before each meaning, got {number}")
        return meanings


def shipped_maps() -> list[str]:
    """Return the names of the register maps that come with this package."""
    return sorted(path.stem for path in (Path(__file__).parents[1] / "maps").glob("*.toml"))


def load_map(name: str) -> RegisterMap:
    """Read a register map, given by the name of a shipped map or by a path.

    Raise `ConfigurationError` if the register map cannot be read or has mistakes. All mistakes are reported
    together.
    """
    path = Path(__file__).parents[1] / "maps" / f"{name}.toml" if name in shipped_maps() else Path(name)
    if not path.is_file():
        known = ", ".join(shipped_maps())
        raise ConfigurationError(
            f"register map {name!r}",
            [f"neither a file nor a shipped map ({known}); correct map of the load frame"],
        )
    return parse_map(read_toml(path), str(path))


def parse_map(data: Mapping[str, Any], source: str) -> RegisterMap:
    """Check the content of a register map. Raise `ConfigurationError`, which names `source` as the file."""
    mistakes: list[str] = []
    register_map = None
    try:
        register_map = RegisterMap.model_validate(data)
    except ValidationError as error:
        mistakes = mistakes_in(error)
    mistakes += mistakes_across(data)
    if register_map is None or mistakes:
        raise ConfigurationError(source, mistakes)
    return register_map
