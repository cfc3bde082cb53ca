"""Operator driver that asks the person at the rig on the terminal."""

import threading

from drivers.errors import DeviceError
from drivers.interfaces import OpenContext, OperatorAction, OperatorQuestion
from drivers.registry import DriverSpec
from drivers.settings import Settings
from drivers.terminal.question import STDIN, Question, Withdrawn

WORDS = {
    OperatorAction.ATTACH_GRID: "attached",
    OperatorAction.REMOVE_GRID: "removed",
    OperatorAction.GO_ON: "untouched",
}
"""The word that confirms each action. The words differ, so that an answer never fits a different question."""

REQUESTS = {
    OperatorAction.REMOVE_GRID: "Please remove the calibration grid and stand back: then the rig moves.",
}
"""Full text of a request, for actions whose name alone does not tell the operator enough."""


class ConsoleOperatorSettings(Settings):
    """Settings of the console operator, which has none."""


class ConsoleOperator:
    """An `Operator` that shows the requested action and waits until the person types the word for it.

    `descriptor` is the file descriptor of the terminal.
    """

    def __init__(self, name: str, descriptor: int = STDIN) -> None:
        self._name = name
        self._descriptor = descriptor
        self._lock = threading.Lock()
        self._question: Question | None = None
        self._closed = False

    def perform(self, action: OperatorAction) -> None:
        """Ask for an action, and wait without a deadline for the word that confirms the action.

        Raise `DeviceError` if the terminal is closed, or if `close` was called.
        """
        request = REQUESTS.get(action, f"Please {action.value}.")
        self._ask(action.value, OperatorQuestion(request, WORDS[action]))

    def ask(self, question: OperatorQuestion) -> None:
        """Ask a question of the protocol, and wait without a deadline for the word that confirms it.

        Raise `DeviceError` if the terminal is closed, or if `withdraw` or `close` was called.
        """
        self._ask("answer a question", question)

    def withdraw(self) -> None:
        """End a question that waits for its answer. Later questions are asked."""
        with self._lock:
            if self._question is not None:
                self._question.withdraw()

    def _ask(self, doing: str, asked: OperatorQuestion) -> None:
        question = Question(asked.text, asked.word, "Ctrl-C to end the run", self._descriptor)
        with self._lock:
            self._question = question
            if self._closed:
                question.withdraw()
        try:
            question.ask()
        except EOFError:
            got = "no answer, because the terminal is closed"
            remedy = "start the run again from a terminal, and answer each question there"
            raise DeviceError(self._name, doing, f'the word "{asked.word}"', got, remedy) from None
        except Withdrawn:
            got = "the end of the run" if self._closed else "a question that was withdrawn"
            remedy = "start the run again"
            raise DeviceError(self._name, doing, f'the word "{asked.word}"', got, remedy) from None
        finally:
            with self._lock:
                self._question = None
            question.close()

    def close(self) -> None:
        """Withdraw a question that waits for its answer. A repeated call has no effect."""
        with self._lock:
            self._closed = True
            if self._question is not None:
                self._question.withdraw()


def open_operator(settings: ConsoleOperatorSettings, context: OpenContext) -> ConsoleOperator:
    """Return an operator who is asked on the terminal of this program."""
    return ConsoleOperator(context.name)


SPEC = DriverSpec(kind="operator", settings=ConsoleOperatorSettings, open=open_operator)
