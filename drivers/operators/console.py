"""The person at the rig, asked on the terminal."""

import sys
from collections.abc import Callable

from drivers.errors import DeviceError
from drivers.interfaces import OpenContext, OperatorAction
from drivers.registry import DriverSpec
from drivers.settings import Settings


class ConsoleOperatorSettings(Settings):
    """No settings."""


class ConsoleOperator:
    """An `Operator` who reads the requested action and confirms with Enter.

    Parameters
    ----------
    name : str
        For messages.
    ask : callable
        Shows a text and returns the typed line; raises EOFError if there is no terminal input.
    """

    def __init__(self, name: str, ask: Callable[[str], str]) -> None:
        self._name = name
        self._ask = ask

    def perform(self, action: OperatorAction) -> None:
        """Ask, and wait without a deadline; `DeviceError` unless the person confirms."""
        try:
            typed = self._ask(f"Please {action.value}, then press Enter (or type no): ").strip()
        except EOFError:
            typed = "no answer, the terminal is closed"
        if typed:
            raise DeviceError(
                self._name,
                action.value,
                "Enter",
                repr(typed),
                "start the run again from a terminal when the rig is ready",
            )


def _ask_on_terminal(text: str) -> str:
    # standard output may be redirected: write the request to standard error
    print(text, end="", file=sys.stderr, flush=True)
    return input()


def open_operator(settings: ConsoleOperatorSettings, context: OpenContext) -> ConsoleOperator:
    """Return an operator on this program's terminal."""
    return ConsoleOperator(context.name, _ask_on_terminal)


SPEC = DriverSpec(kind="operator", settings=ConsoleOperatorSettings, open=open_operator)
