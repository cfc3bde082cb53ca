"""Values in Modbus registers: types, word orders, scales, and blocks transferred in one request."""

import math
import struct
from collections.abc import Collection, Mapping, Sequence
from typing import Literal, Self

from pydantic import Field, model_validator

from drivers.settings import Settings

Number = int | float
WordOrder = Literal["ABCD", "CDAB", "BADC", "DCBA"]
Unit = Literal["", "N", "mm", "N/s", "mm/s", "s"]
RAW_BOUNDS = {"u16": (0, 2**16), "i16": (-(2**15), 2**15), "u32": (0, 2**32), "i32": (-(2**31), 2**31)}
FORMATS = {"u16": "H", "i16": "h", "u32": "I", "i32": "i", "f32": "f"}
# A value that rounds to 0 would have another meaning in these registers: off, or never.
NEVER_ROUNDED_TO_0 = ("N/s", "mm/s", "s")


class Register(Settings):
    """One value: address, encoding and range.

    Attributes
    ----------
    address : int
        As in the Modbus message, from 0.
    type : str
    scale : float
        Value in `unit` = raw value × scale.
    unit : str
    invalid : list of int
        Raw values that mean "no value", such as 0x7FFFFFFF for a broken wire. These values are never written.
    valid : list of two floats, optional
        Least and greatest possible value (in `unit`).
    """

    address: int = Field(ge=0, le=0xFFFF)
    type: Literal["u16", "i16", "u32", "i32", "f32"]
    scale: float = Field(default=1.0, gt=0)
    unit: Unit = ""
    invalid: list[int] = Field(default_factory=list)
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
        """Length in registers."""
        return struct.calcsize(">" + FORMATS[self.type]) // 2

    @property
    def end(self) -> int:
        """The address after the last one."""
        return self.address + self.size

    def decode(self, words: Sequence[int], order: WordOrder) -> Number:
        """Return the value in its unit.

        Raises
        ------
        ValueError
            If the raw value is NaN, infinite, a sentinel, or out of range.
        """
        raw: Number = struct.unpack(
            ">" + FORMATS[self.type], _ordered(struct.pack(f">{self.size}H", *words), order)
        )[0]
        value = raw if self.scale == 1.0 else raw * self.scale
        self._refuse_impossible(raw, value)
        return value

    def encode(self, value: Number, order: WordOrder) -> list[int]:
        """Return the words that represent a value.

        Raises
        ------
        ValueError
            If the type cannot hold the value, `decode` would refuse it, or a rate or time would become 0.
        """
        format = ">" + FORMATS[self.type]
        raw = value if self.scale == 1.0 else value / self.scale
        try:
            # some machines report the negative zero of a float as positive zero
            packed = struct.pack(format, raw + 0.0 if self.type == "f32" else round(raw))
        except (struct.error, OverflowError, ValueError) as error:
            raise ValueError(
                f"{value:g} {self.unit} does not fit {self.type} with scale {self.scale:g}"
            ) from error
        (shown,) = struct.unpack(format, packed)
        if value and not shown and self.unit in NEVER_ROUNDED_TO_0:
            raise ValueError(f"{value:g} {self.unit} would be 0 in {self.type} with scale {self.scale:g}")
        self._refuse_impossible(shown, value)
        return list(struct.unpack(f">{self.size}H", _ordered(packed, order)))

    def _refuse_impossible(self, raw: Number, value: Number) -> None:
        if raw in self.invalid or not math.isfinite(raw):
            raise ValueError(f"no valid value ({raw})")
        if self.valid is not None and not self.valid[0] <= value <= self.valid[1]:
            raise ValueError(f"{value:g} {self.unit}, outside {self.valid[0]:g} to {self.valid[1]:g}")


class Block(Settings):
    """Registers that are read or written together, without a gap between them.

    Attributes
    ----------
    table : str
        `input`, read by function 4, or `holding`, read by 3 and written by 16.
    single : bool
        Write the block, which is one register, by function 6: some devices have no other.
    registers : dict of Register
    """

    table: Literal["input", "holding"]
    single: bool = False
    registers: dict[str, Register] = Field(min_length=1)

    @property
    def address(self) -> int:
        """Address of the first register."""
        return min(register.address for register in self.registers.values())

    @property
    def count(self) -> int:
        """Length in registers."""
        return sum(register.size for register in self.registers.values())

    def decode(
        self, words: Sequence[int], order: WordOrder, names: Collection[str] | None = None
    ) -> dict[str, Number]:
        """Return all or the named values by name; `ValueError` names a register without a valid value."""
        values = {}
        for name, register in self.registers.items():
            if names is not None and name not in names:
                continue
            first = register.address - self.address
            try:
                values[name] = register.decode(words[first : first + register.size], order)
            except ValueError as error:
                raise ValueError(f"{name} is {error}") from error
        return values

    def encode(
        self, values: Mapping[str, Number], order: WordOrder, onto: Sequence[int] | None = None
    ) -> list[int]:
        """Return the block's words; registers without a value keep the words of `onto`, or are 0.

        `ValueError` names the register that cannot hold its value.
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
    """Convert bytes to or from the word order of the registers; each order is its own inverse."""
    if order in ("BADC", "DCBA"):
        data = b"".join(data[i : i + 2][::-1] for i in range(0, len(data), 2))
    if order in ("CDAB", "DCBA"):
        data = b"".join(data[i : i + 2] for i in range(len(data) - 2, -1, -2))
    return data
