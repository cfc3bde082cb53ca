import pytest

from drivers.errors import DeviceError
from drivers.interfaces import OperatorAction
from drivers.operators.console import SPEC, ConsoleOperator


def test_a_person_reads_what_to_do_and_presses_enter():
    shown: list[str] = []

    def ask(text: str) -> str:
        shown.append(text)
        return ""

    ConsoleOperator("operator", ask).perform(OperatorAction.REMOVE_GRID)
    assert "remove the calibration grid" in shown[0]


def test_a_person_who_says_no_ends_the_run():
    with pytest.raises(DeviceError, match=r"attach the calibration grid .* got 'no'"):
        ConsoleOperator("operator", lambda text: "no\n").perform(OperatorAction.ATTACH_GRID)


def test_nobody_at_the_terminal_is_an_error_and_no_traceback(monkeypatch, context, capsys):
    def nobody() -> str:
        raise EOFError

    monkeypatch.setattr("builtins.input", nobody)
    with pytest.raises(DeviceError, match="the terminal is closed"):
        SPEC.open(SPEC.settings(), context).perform(OperatorAction.ATTACH_GRID)
    assert "attach" in capsys.readouterr().err
