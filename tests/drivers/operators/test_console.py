"""Tests of the console operator at a pseudo-terminal, at a pipe, and without any input."""

import os
import pty
import select
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from types import SimpleNamespace

import pytest

from drivers.errors import DeviceError
from drivers.interfaces import OperatorAction, OperatorQuestion
from drivers.operators.console import SPEC, WORDS, ConsoleOperator
from drivers.terminal.question import WRONG_LINES_MAX

DEADLINE_S = 60.0


@dataclass
class Asked(threading.Thread):
    """A question that waits for its answer on a separate thread, as in a run."""

    operator: ConsoleOperator
    action: OperatorAction | OperatorQuestion
    failures: list[DeviceError] = field(default_factory=list)
    returned: bool = False

    def __post_init__(self) -> None:
        super().__init__(daemon=True)
        self.start()

    def __hash__(self) -> int:
        return id(self)

    def run(self) -> None:
        try:
            if isinstance(self.action, OperatorQuestion):
                self.operator.ask(self.action)
            else:
                self.operator.perform(self.action)
            self.returned = True
        except DeviceError as error:
            self.failures.append(error)

    def ended(self) -> bool:
        self.join(DEADLINE_S)
        return not self.is_alive()


class Person:
    """A simulated person at a terminal, who reads the shown text and types."""

    def __init__(self, screen: int, keyboard: int, operator: ConsoleOperator) -> None:
        self._screen, self._keyboard = screen, keyboard
        self.operator = operator
        self.seen = ""

    def type(self, keys: str) -> None:
        os.write(self._keyboard, keys.encode())

    def see(self, text: str) -> None:
        while text not in self.seen:
            ready = select.select([self._screen], [], [], DEADLINE_S)[0]
            assert ready, f"{text!r} did not appear in {self.seen!r}"
            self.seen += os.read(self._screen, 1000).decode()

    def forget(self) -> None:
        self.seen = ""


@contextmanager
def _pipe() -> Iterator[tuple[int, int]]:
    ends = os.pipe()
    try:
        yield ends
    finally:
        for end in ends:
            os.close(end)


@pytest.fixture
def person(monkeypatch) -> Iterator[Person]:
    """A person who types at a pseudo-terminal, and reads the program's text from a pipe."""
    keyboard, terminal = pty.openpty()
    with _pipe() as (screen, shown), open(shown, "w", closefd=False) as stderr:
        monkeypatch.setattr("drivers.terminal.question.sys", SimpleNamespace(stderr=stderr))
        operator = ConsoleOperator("operator", terminal)
        yield Person(screen, keyboard, operator)
        operator.close()
    os.close(keyboard)
    os.close(terminal)


def test_a_question_of_a_protocol_is_asked_and_one_that_is_answered_elsewhere_is_withdrawn(person):
    question = OperatorQuestion("Please take the extensometer off.", "off")
    asked = Asked(person.operator, question)
    person.see("Please take the extensometer off.\nType off when it is done, Ctrl-C to end the run: ")
    person.operator.withdraw()
    assert asked.ended()
    assert 'operator: answer a question: expected the word "off"' in str(asked.failures[0])
    person.forget()
    again = Asked(person.operator, question)
    person.see("Type off when it is done")
    person.type("OFF\n")
    assert again.ended()
    assert again.returned


def test_a_person_reads_what_to_do_and_types_the_word(person):
    asked = Asked(person.operator, OperatorAction.REMOVE_GRID)
    person.see("Please remove the calibration grid and stand back: then the rig moves.\n")
    person.see("Type removed when it is done, Ctrl-C to end the run: ")
    assert asked.is_alive()
    person.type("removed\n")
    assert asked.ended()
    assert asked.returned


def test_every_action_has_a_word_of_its_own():
    assert set(WORDS) == set(OperatorAction)
    assert len(set(WORDS.values())) == len(WORDS)


@pytest.mark.parametrize("typed", ["\n", "\n\n\n", "done\n", "y\n", "removed\n", "attach\n"])
def test_a_wrong_word_asks_again_and_does_not_end_the_run(person, typed):
    asked = Asked(person.operator, OperatorAction.ATTACH_GRID)
    person.see("run: ")
    person.forget()
    person.type(typed)
    person.see("is not the word. Type attached when it is done")
    assert asked.is_alive()
    person.type(" Attached \n")
    assert asked.ended()
    assert asked.returned


def test_what_was_typed_before_a_question_does_not_answer_it(person):
    first = Asked(person.operator, OperatorAction.ATTACH_GRID)
    person.see("run: ")
    person.type("attached\n\n\nremoved\nremoved\n")
    assert first.ended()
    assert first.returned
    person.forget()
    second = Asked(person.operator, OperatorAction.REMOVE_GRID)
    person.see("Type removed when it is done")
    person.type("later\n")
    # the first line that is read was typed after the question
    person.see('"later" is not the word')
    assert second.is_alive()
    person.type("removed\n")
    assert second.ended()
    assert second.returned


def test_ctrl_d_ends_the_question_with_a_sentence(person):
    asked = Asked(person.operator, OperatorAction.ATTACH_GRID)
    person.see("run: ")
    person.type("\x04")
    assert asked.ended()
    assert "got no answer, because the terminal is closed; start the run again" in str(asked.failures[0])


def test_a_terminal_that_goes_away_ends_the_question(monkeypatch):
    keyboard, terminal = pty.openpty()
    operator = ConsoleOperator("operator", terminal)
    asked = Asked(operator, OperatorAction.ATTACH_GRID)
    os.close(keyboard)
    assert asked.ended()
    assert "the terminal is closed" in str(asked.failures[0])
    os.close(terminal)


@pytest.mark.parametrize("asks_already", [True, False])
def test_the_end_of_a_run_withdraws_the_question_at_once(person, asks_already):
    if asks_already:
        asked = Asked(person.operator, OperatorAction.ATTACH_GRID)
        person.see("run: ")
        person.operator.close()
    else:
        person.operator.close()
        asked = Asked(person.operator, OperatorAction.ATTACH_GRID)
    assert asked.ended()
    assert "got the end of the run" in str(asked.failures[0])
    # later input is for others, and not for the withdrawn question
    person.type("attached\n")
    assert not asked.returned


def test_signs_that_control_a_terminal_are_not_shown_again(person):
    asked = Asked(person.operator, OperatorAction.ATTACH_GRID)
    person.see("run: ")
    person.type("\x1b[2J" + 30 * "x" + "\n")
    person.see("is not the word")
    assert "\x1b" not in person.seen
    assert f'"?[2J{16 * "x"}…"' in person.seen
    person.type("attached\n")
    assert asked.ended()


def test_a_pipe_answers_each_question_with_its_word(capsys):
    with _pipe() as (answers, script):
        os.write(script, b"attached\nremoved\nrest")
        operator = ConsoleOperator("operator", answers)
        operator.perform(OperatorAction.ATTACH_GRID)
        operator.perform(OperatorAction.REMOVE_GRID)
        assert os.read(answers, 10) == b"rest"
    assert "Standard input is no terminal" in capsys.readouterr().err


def test_a_program_that_answers_without_end_is_not_read_without_end():
    with _pipe() as (answers, script):
        os.write(script, b"y\n" * (WRONG_LINES_MAX + 2))
        with pytest.raises(DeviceError, match="no answer"):
            ConsoleOperator("operator", answers).perform(OperatorAction.ATTACH_GRID)
        assert os.read(answers, 100) == b"y\n"


def test_nobody_at_the_terminal_is_an_error_and_no_traceback(context, capsys):
    null = os.open(os.devnull, os.O_RDONLY)
    saved = os.dup(0)
    os.dup2(null, 0)
    try:
        with pytest.raises(DeviceError, match="the terminal is closed"):
            SPEC.open(SPEC.settings(), context).perform(OperatorAction.ATTACH_GRID)
    finally:
        os.dup2(saved, 0)
        os.close(saved)
        os.close(null)
    assert "attach" in capsys.readouterr().err
