"""Convert values to and from Modbus registers: types, word orders, scales, and blocks of registers."""

import math
import struct
from collections.abc import Collection, Mapping, Sequence
from functools import cached_property
from typing import Literal, Self

from pydantic import Field, model_validator

from drivers.settings import Settings

Number = int | float
WordOrder = Literal["ABCD", "CDAB", "BADC", "DCBA"]
Unit = Literal["", "N", "mm", "N/s", "mm/s", "s"]
RAW_BOUNDS = {"u16": (0, 2**16), "i16": (-(2**15), 2**15), "u32": (0, 2**32), "i32": (-(2**31), 2**31)}
_VALUES = {
    "u16": struct.Struct(">H"),
    "i16": struct.Struct(">h"),
    "u32": struct.Struct(">I"),
    "i32": struct.Struct(">i"),
    "f32": struct.Struct(">f"),
}
_SIZES = {name: value.size // 2 for name, value in _VALUES.items()}
_WORDS = {size: struct.Struct(f">{size}H") for size in _SIZES.values()}
# In registers with these units, 0 means "off" or "never". So a small value must not be rounded to 0.
NEVER_ROUNDED_TO_0 = ("N/s", "mm/s", "s")


class Register(Settings):
    """Address, encoding and range of one value in a register map."""

    # address as in the Modbus message. The first register has address 0.
    address: int = Field(ge=0, le=0xFFFF)
    type: Literal["u16", "i16", "u32", "i32", "f32"]
    # scale factor: the value in `unit` is the raw value times `scale`
    scale: float = Field(default=1.0, gt=0)
    unit: Unit = ""
    # raw values that mean "no value", such as 0x7FFFFFFF for a broken wire. The driver never writes these
    # values.
    invalid: list[int] = Field(default_factory=list)
    # smallest and largest possible value, in `unit`
    valid: list[float] | None = Field(default=None, min_length=2, max_length=2)

    @model_validator(mode="after")
    def _ordered_range(self) -> Self:
        if self.valid is not None and self.valid[0] >= self.valid[1]:
            raise ValueError("valid must be a lower and a higher value")
        return self

    @model_validator(mode="after")
    def _possible_sentinels(self) -> Self:
        for raw in self.invalid:
            if not self._can_show(raw):
                raise ValueError(
                    f"invalid: {raw} never stands in {self.type}; write it as signed or unsigned, not as bits"
                )
        return self

    def _can_show(self, raw: int) -> bool:
        if self.type != "f32":
            low, high = RAW_BOUNDS[self.type]
            return low <= raw < high
        try:
            return bool(struct.unpack(">f", struct.pack(">f", raw))[0] == raw)
        except (struct.error, OverflowError):
            return False

    @property
    def size(self) -> int:
        """Number of registers that this value takes."""
        return _SIZES[self.type]

    @property
    def end(self) -> int:
        """Address that follows the last register of this value."""
        return self.address + self.size

    def decode(self, words: Sequence[int], order: WordOrder) -> Number:
        """Return the value in its unit.

        Raise `ValueError` if the raw value is NaN, infinite or out of range, or means "no value".
        """
        raw: Number
        (raw,) = _VALUES[self.type].unpack(_ordered(_WORDS[self.size].pack(*words), order))
        value = raw if self.scale == 1.0 else raw * self.scale
        self._refuse_impossible(raw, value)
        return value

    def encode(self, value: Number, order: WordOrder) -> list[int]:
        """Return the register words that represent a value.

        Raise `ValueError` if the register type cannot hold the value, if `decode` would refuse the value, or
        if a rate or time would be rounded to 0.
        """
        encoding = _VALUES[self.type]
        raw = value if self.scale == 1.0 else value / self.scale
        try:
            # avoid the negative zero, because some machines report it as positive zero
            packed = encoding.pack(raw + 0.0 if self.type == "f32" else round(raw))
        except (struct.error, OverflowError, ValueError) as error:
            raise ValueError(
                f"{value:g} {self.unit} does not fit {self.type} with scale {self.scale:g}"
            ) from error
        (shown,) = encoding.unpack(packed)
        if value and not shown and self.unit in NEVER_ROUNDED_TO_0:
            raise ValueError(f"{value:g} {self.unit} would be 0 in {self.type} with scale {self.scale:g}")
        self._refuse_impossible(shown, value)
        return list(_WORDS[self.size].unpack(_ordered(packed, order)))

    def _refuse_impossible(self, raw: Number, value: Number) -> None:
        if raw in self.invalid or not math.isfinite(raw):
            raise ValueError(f"no valid value ({raw})")
        if self.valid is not None and not self.valid[0] <= value <= self.valid[1]:
            raise ValueError(f"{value:g} {self.unit}, outside {self.valid[0]:g} to {self.valid[1]:g}")


class Block(Settings):
    """Registers that are read or written together, without a gap between them."""

    # Modbus table: `input` is read with function 4; `holding` is read with function 3 and written with
    # function 16
    table: Literal["input", "holding"]
    # True to write the block with function 6, for devices without function 16. The block must be a single
    # register.
    single: bool = False
    registers: dict[str, Register] = Field(min_length=1)

    @cached_property
    def address(self) -> int:
        """Address of the first register."""
        return min(register.address for register in self.registers.values())

    @cached_property
    def count(self) -> int:
        """Number of registers in the block."""
        return sum(register.size for register in self.registers.values())

    def decode(
        self, words: Sequence[int], order: WordOrder, names: Collection[str] | None = None
    ) -> dict[str, Number]:
        """Return the values by name. Raise `ValueError` if a register has no valid value."""
        values, start = {}, self.address
        for name, register in self.registers.items():
            if names is not None and name not in names:
                continue
            first = register.address - start
            try:
                values[name] = register.decode(words[first : first + register.size], order)
            except ValueError as error:
                raise ValueError(f"{name} is {error}") from error
        return values

    def encode(
        self, values: Mapping[str, Number], order: WordOrder, onto: Sequence[int] | None = None
    ) -> list[int]:
        """Return the words of the block. Registers without a new value keep the words of `onto`, or are 0.

        If a register cannot hold its value, `ValueError` gives the name of the register.
        """
        words = [0] * self.count if onto is None else list(onto)
        for name, value in values.items():
            register = self.registers[name]
            first = register.address - self.address
            try:
                words[first : first + register.size] = register.encode(value, order)
            except ValueError as error:
                raise ValueError(f"{name}: {error}") from error
        return words


def _ordered(data: bytes, order: WordOrder) -> bytes:
    """Convert bytes to or from the word order of the registers; both conversions are the same operation."""
    if order in ("BADC", "DCBA"):
        data = b"".join(data[i : i + 2][::-1] for i in range(0, len(data), 2))
    if order in ("CDAB", "DCBA"):
        data = b"".join(data[i : i + 2] for i in range(len(data) - 2, -1, -2))
    return data
