"""The interlock driver passes the contract tests for contacts and registers, on every kind of line."""

from abc import ABC, abstractmethod
from collections.abc import Iterator
from contextlib import closing
from functools import partial
from typing import ClassVar

import pytest

from drivers.clock import VirtualClock
from drivers.interfaces import OpenContext
from drivers.interlocks.modbus import ModbusInputSettings, open_input
from drivers.testing import InterlockBench, InterlockContract
from simulators.interlock.module import InputModule, InputModuleRtuServer, InputModuleServer
from simulators.wire.ports import LOCALHOST

LINES = {
    "tcp": (InputModuleServer, "{}", {}),
    # a pseudo-terminal carries no parity bits
    "rtu": (InputModuleRtuServer, "{}", {"parity": "N"}),
    "rtu-over-tcp": (partial(InputModuleRtuServer, host=LOCALHOST), "rtu://{}", {}),
}
READING_FUNCTIONS = {1, 2, 3, 4}
BROKEN_WIRE = 0x7FFF


class Module(InputModule):
    """A simulated module that counts the requests that could change its state."""

    def __init__(self) -> None:
        super().__init__()
        self.changes = 0

    def answer(self, request: bytes) -> bytes:
        self.changes += request[0] not in READING_FUNCTIONS
        return super().answer(request)


@pytest.mark.parametrize("line", LINES)
class Lines(InterlockContract, ABC):
    """The contract tests on one kind of line. The subclasses choose the input that is read."""

    settings: ClassVar[dict[str, object]]
    values: tuple[float, ...]
    has_sensor = False

    @abstractmethod
    def show(self, module: Module, value: float) -> None:
        """Set the true value of the input."""

    @pytest.fixture
    def bench(self, line: str) -> Iterator[InterlockBench]:
        serve, url, line_settings = LINES[line]
        module, clock = Module(), VirtualClock()
        with closing(serve(module)) as server:
            show = partial(self.show, module)
            show(self.values[0])
            settings = ModbusInputSettings(
                address=url.format(server.address), reply_timeout_s=0.3, **self.settings, **line_settings
            )
            with closing(open_input(settings, OpenContext("interlocks.door", clock))) as interlock:
                yield InterlockBench(
                    interlock,
                    clock,
                    self.values,
                    tolerance=1e-9,
                    show=show,
                    changes=lambda: module.changes,
                    lose_answers=lambda: server.faults.switch_on("drop"),
                    restore=server.faults.clear,
                    unplug=lambda: server.faults.switch_on("unplug"),
                    break_sensor=partial(module.set_register, 3, BROKEN_WIRE) if self.has_sensor else None,
                )


class TestContact(Lines):
    settings: ClassVar = {"number": 5}
    values = (1.0, 0.0)

    def show(self, module: Module, value: float) -> None:
        module.set_contact(5, closed=value == 1.0)


class TestRegister(Lines):
    settings: ClassVar = {
        "number": 3,
        "table": "input",
        "signed": True,
        "scale": 0.1,
        "quantity": "°C",
        "invalid": [BROKEN_WIRE],
    }
    values = (23.5, -12.5, 40.0)
    has_sensor = True

    def show(self, module: Module, value: float) -> None:
        module.set_register(3, round(value / 0.1))
