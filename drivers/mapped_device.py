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
    """

    def __init__(self, link: ModbusLink, register_map: RegisterMap) -> None:
        self.name = link.name
        self._link = link
        self._map = register_map

    def read(self, block: Block, step: str, names: Collection[str] | None = None) -> dict[str, Number]:
        """Return a block's values, or those named, each in its unit.

        Raises
        ------
        DeviceFault
            If one of them is NaN, a sentinel or out of range.
        """
        words = self._link.read(block.table, block.address, block.count)
        try:
            return block.decode(words, self._map.word_order, names)
        except ValueError as error:
            raise self.fault(
                step, "valid values", str(error), "check sensor, cable and register map"
            ) from error

    def read_state(self, step: str) -> dict[str, Number]:
        """Return the values of the block `state`.

        Raises
        ------
        DeviceFault
            Also if it is of another revision of the map, or marks the load as invalid.
        """
        values = self.read(self._map.blocks.state, step)
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
        self._link.write(block.address, self._encode(block, values, step))

    def write_checked(self, block: Block, values: Mapping[str, Number], step: str) -> None:
        """Write a block and read it back; `DeviceFault` unless every word is the same."""
        words = self._encode(block, values, step)
        self._link.write(block.address, words)
        if self._link.read(block.table, block.address, block.count) != words:
            found = _shown(self.read(block, step))
            raise self.fault(
                step, _shown(values), f"{found} on reading back", "check the machine's own settings"
            )

    def fault(self, step: str, expected: str, got: str, remedy: str) -> DeviceFault:
        """Return an error of this device, to be raised."""
        return DeviceFault(self.name, step, expected=expected, got=got, remedy=remedy)

    def close(self) -> None:
        """Release the connection; harmless when repeated."""
        self._link.close()

    def _encode(self, block: Block, values: Mapping[str, Number], step: str) -> list[int]:
        try:
            return block.encode(values, self._map.word_order)
        except ValueError as error:
            raise self.fault(step, "values that fit", str(error), "correct the register map") from error


def _shown(values: Mapping[str, Number]) -> str:
    return ", ".join(f"{name} {value:g}" for name, value in values.items())
