"""A Modbus device seen through its register map: values by name instead of words by address."""

from collections.abc import Collection, Mapping

from drivers.errors import DeviceFault
from drivers.modbus_link import ModbusLink
from drivers.register_map import RegisterMap
from drivers.registers import Block, Number


class MappedDevice:
    """Reads and writes whole blocks.

    Parameters
    ----------
    link : ModbusLink
    register_map : RegisterMap
    urgent : bool
        Go first on a link that others use too.
    """

    def __init__(self, link: ModbusLink, register_map: RegisterMap, *, urgent: bool = False) -> None:
        self.name = link.name
        self._link = link
        self._map = register_map
        self._urgent = urgent

    def read(self, block: Block, step: str, names: Collection[str] | None = None) -> dict[str, Number]:
        """Return a block's values, or those named, each in its unit.

        Raises
        ------
        DeviceFault
            If one of them is NaN, a sentinel or out of range.
        """
        words = self._words(block)
        try:
            return block.decode(words, self._map.word_order, names)
        except ValueError as error:
            raise self.fault(
                step, "valid values", str(error), "check sensor, cable and register map"
            ) from error

    def read_status(self, step: str) -> dict[str, Number]:
        """Return status word and executed command, and nothing that a broken load cell can spoil."""
        blocks = self._map.blocks
        return self.read(blocks.status or blocks.state, step, names=("status", "executed"))

    def read_state(self, step: str) -> dict[str, Number]:
        """Return the values of the block `state`, and those of `status` where they stand apart.

        The status is read first then: what it says of the machine is never newer than load and displacement.

        Raises
        ------
        DeviceFault
            Also if it is of another revision of the map, or marks the load as invalid.
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

    def write(self, block: Block, values: Mapping[str, Number], step: str) -> None:
        """Write a block in one request; registers that are not named become 0."""
        self._write_words(block, self._encode(block, values, step))

    def write_checked(self, block: Block, values: Mapping[str, Number], step: str) -> None:
        """Write a block and read it back; `DeviceFault` unless every word is the same."""
        words = self._encode(block, values, step)
        self._write_words(block, words)
        if self._words(block) != words:
            found = _shown(self.read(block, step))
            raise self.fault(
                step, _shown(values), f"{found} on reading back", "check the machine's own settings"
            )

    def set(self, block: Block, values: Mapping[str, Number], step: str) -> None:
        """Make a block of settings hold `values`; written only if it does not: memory wears with writing."""
        if not self.holds(block, values, step):
            self.write_checked(block, values, step)

    def holds(self, block: Block, values: Mapping[str, Number], step: str) -> bool:
        """Whether a block of settings has `values`, word for word."""
        return self._words(block) == self._encode(block, values, step)

    def fault(self, step: str, expected: str, got: str, remedy: str) -> DeviceFault:
        """Return an error of this device, to be raised."""
        return DeviceFault(self.name, step, expected=expected, got=got, remedy=remedy)

    def close(self) -> None:
        """Release the connection; harmless when repeated."""
        self._link.close()

    def _words(self, block: Block) -> list[int]:
        return self._link.read(block.table, block.address, block.count, urgent=self._urgent)

    def _write_words(self, block: Block, words: list[int]) -> None:
        self._link.write(block.address, words, urgent=self._urgent, single=block.single)

    def _encode(self, block: Block, values: Mapping[str, Number], step: str) -> list[int]:
        try:
            return block.encode(values, self._map.word_order)
        except ValueError as error:
            raise self.fault(step, "values that fit", str(error), "correct the register map") from error


def _shown(values: Mapping[str, Number]) -> str:
    return ", ".join(f"{name} {value:g}" for name, value in values.items())
