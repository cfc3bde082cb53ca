"""Read and write the registers of a Modbus device by name, with the register map of the device."""

import contextlib
from collections.abc import Collection, Iterator, Mapping

from drivers.errors import DeviceError, DeviceFault
from drivers.load_frames.modbus.bus.link import ModbusLink
from drivers.load_frames.modbus.registers.map import RegisterMap
from drivers.load_frames.modbus.registers.registers import Block, Number


class MappedDevice:
    """A Modbus device whose registers are read and written in whole blocks.

    `urgent` is True if the requests of this object go before all other requests on the link.
    """

    def __init__(self, link: ModbusLink, register_map: RegisterMap, *, urgent: bool = False) -> None:
        self.name = link.name
        self._link = link
        self._map = register_map
        self._urgent = urgent

    def read(self, block: Block, step: str, names: Collection[str] | None = None) -> dict[str, Number]:
        """Return the values of a block, each in its unit. `names` limits the result to some registers.

        Raise `DeviceFault` if a value is NaN, is out of range, or means "no value".
        """
        return self._decoded(block, self._words(block, step), step, names)

    def read_valid(self, block: Block, step: str, names: Collection[str]) -> dict[str, Number]:
        """Return the values of all registers of a block that have a valid value.

        Raise `DeviceFault` if a register in `names` has no valid value.
        """
        words = self._words(block, step)
        found = self._decoded(block, words, step, names)
        for name in block.registers.keys() - names:
            # ignore an unused register without a valid value, because it may contain anything
            with contextlib.suppress(ValueError):
                found |= block.decode(words, self._map.word_order, (name,))
        return found

    def identify(self, step: str) -> dict[str, Number]:
        """Return the values of the block `identity`. From now on the link identifies the machine by them."""
        block = self._map.blocks.identity
        words = self._words(block, step)
        self._link.prove_by(block.table, block.address, words)
        return self._decoded(block, words, step)

    def _decoded(
        self, block: Block, words: list[int], step: str, names: Collection[str] | None = None
    ) -> dict[str, Number]:
        try:
            return block.decode(words, self._map.word_order, names)
        except ValueError as error:
            raise self.fault(
                step, "valid values", str(error), "check sensor, cable and register map"
            ) from error

    def read_status(self, step: str) -> dict[str, Number]:
        """Return the status word and the number of the executed command, without load and displacement."""
        blocks = self._map.blocks
        return self.read(blocks.status or blocks.state, step, names=("status", "executed"))

    def read_state(self, step: str) -> dict[str, Number]:
        """Return the values of the block `state` and, if the map has it, of the block `status`.

        The block `status` is read first, so load and displacement are never older than the status.

        Raise `DeviceFault` if a value is NaN, out of range or means "no value", if the machine's register
        `revision` differs from the map, or if the status says that the load is invalid.
        """
        blocks = self._map.blocks
        values = {} if blocks.status is None else self.read(blocks.status, step)
        values |= self.read(blocks.state, step)
        if values["revision"] != self._map.revision:
            expected, got = f"register map revision {self._map.revision}", f"{values['revision']:g}"
            raise self.fault(step, expected, got, "use the map that belongs to the machine")
        if not int(values["status"]) >> self._map.status.load_valid & 1:
            raise self.fault(
                step, "a valid load", "a load marked invalid", "check the load cell and its cable"
            )
        return values

    def write(self, block: Block, values: Mapping[str, Number], step: str, *, harmless: bool = False) -> None:
        """Write a block in one request. Registers that are not named in `values` become 0.

        After a missing answer, the request is repeated if `harmless` says that a second execution has no
        effect.
        """
        self._write_words(block, self._encode(block, values, step), step, harmless=harmless)

    def set(self, block: Block, values: Mapping[str, Number], step: str) -> None:
        """Set registers of a block to `values`, and leave the other registers of the block unchanged.

        If the block already has these values, nothing is written, because writing wears the machine's memory.
        Otherwise the block is written and read back. `DeviceFault` is raised if the values differ.
        """
        found = self._words(block, step)
        wanted = self._encode(block, values, step, found)
        if found == wanted:
            return
        self._write_words(block, wanted, step)
        if not self.holds(block, values, step):
            got = f"{_shown(self.read(block, step, values))} on reading back"
            raise self.fault(step, _shown(values), got, "check the machine's own settings")

    def holds(self, block: Block, values: Mapping[str, Number], step: str) -> bool:
        """Return whether the registers of a block contain exactly `values`."""
        found = self._words(block, step)
        return found == self._encode(block, values, step, found)

    def fault(self, step: str, expected: str, got: str, remedy: str) -> DeviceFault:
        """Return a `DeviceFault` with the name of this device. The caller raises the error."""
        return DeviceFault(self.name, step, expected, got, remedy)

    def unhurried(self) -> "MappedDevice":
        """Return a copy of this device that sends ordinary requests on the same link, and no urgent ones."""
        return MappedDevice(self._link, self._map)

    def shares_link(self, other: "MappedDevice") -> bool:
        """Return whether this device and `other` use the same connection."""
        return self._link is other._link

    def close(self) -> None:
        """Release the connection. A repeated call has no effect."""
        self._link.close()

    def _words(self, block: Block, step: str) -> list[int]:
        with _during(step):
            return self._link.read(block.table, block.address, block.count, urgent=self._urgent)

    def _write_words(self, block: Block, words: list[int], step: str, *, harmless: bool = False) -> None:
        with _during(step):
            self._link.write(
                block.address, words, urgent=self._urgent, single=block.single, harmless=harmless
            )

    def _encode(
        self, block: Block, values: Mapping[str, Number], step: str, onto: list[int] | None = None
    ) -> list[int]:
        try:
            return block.encode(values, self._map.word_order, onto)
        except ValueError as error:
            raise self.fault(step, "values that fit", str(error), "correct the register map") from error


@contextlib.contextmanager
def _during(step: str) -> Iterator[None]:
    """Put the text `step` before the step in every error of the link."""
    try:
        yield
    except DeviceError as error:
        raise type(error)(
            error.device, f"{step}: {error.step}", error.expected, error.got, error.remedy
        ) from error


def _shown(values: Mapping[str, Number]) -> str:
    return ", ".join(f"{name} {value:g}" for name, value in values.items())
