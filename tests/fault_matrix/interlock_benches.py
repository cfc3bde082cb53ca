"""Benches of one input of a Modbus module, on each kind of line.

The input changes before each reading, so that a late answer to an earlier request is noticed.
"""

from abc import abstractmethod
from collections.abc import Callable
from typing import Any, ClassVar

from drivers.interfaces import OpenContext
from drivers.interlocks.modbus import ModbusInputSettings, open_input
from simulators.interlock.module import InputModule
from tests.fault_matrix.bench import Bench, UnprovenError, WrongAnswerError
from tests.fault_matrix.machine_benches import REPLY_TIMEOUT_S

NUMBER = 3


class _InputBench(Bench):
    """An input whose value changes before each reading."""

    settings: ClassVar[dict[str, object]]

    def __init__(self, serve: Callable[..., Any], prefix: str = "", *, numbered: bool = True) -> None:
        super().__init__()
        if not numbered:
            self.unproven = frozenset({"late", "stale"})
        self._module = InputModule()
        self._server = serve(self._module)
        self.faults = self._server.faults
        self._prefix = prefix
        self._count = 0
        self.uses = {"read": self._read}
        self.ways_back = {"": lambda: None, "open": self.open}

    def opened(self, context: OpenContext) -> Any:
        """Return the driver, opened."""
        settings = ModbusInputSettings(
            address=self._prefix + self._server.address,
            number=NUMBER,
            reply_timeout_s=REPLY_TIMEOUT_S,
            **self.settings,
            # a pseudo-terminal carries no parity bits
            **({"parity": "N"} if self._server.address.startswith("/") else {}),
        )
        return open_input(settings, context)

    def prepare(self) -> None:
        """Read the input once."""
        self._read()

    def works(self) -> None:
        """Read the input with each of its values."""
        self._read()
        self._read()

    def close(self) -> None:
        """Close the driver and the line."""
        self.shut()
        self._server.close()

    def _read(self) -> None:
        self._count += 1
        true = self.change(self._module, self._count)
        value = self.driver.read().value
        if value != true:
            wrong = f"read {value:g}, is {true:g}"
            raise UnprovenError(wrong) if self.unproven else WrongAnswerError(wrong)

    @abstractmethod
    def change(self, module: InputModule, count: int) -> float:
        """Set the input to another value than before, and return this value."""


class ContactBench(_InputBench):
    """A contact that opens and closes."""

    settings: ClassVar = {"table": "discrete"}

    def change(self, module: InputModule, count: int) -> float:
        """Open the contact if it is closed, and close it otherwise."""
        module.set_contact(NUMBER, closed=count % 2 == 0)
        return float(count % 2 == 0)


class RegisterBench(_InputBench):
    """A register with a number that grows."""

    settings: ClassVar = {"table": "input"}

    def change(self, module: InputModule, count: int) -> float:
        """Set the register to the next number."""
        module.set_register(NUMBER, count)
        return float(count)
