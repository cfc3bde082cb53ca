"""Time limits of tests: a limit that is hit fails one test, and the run goes on. A plugin of pytest."""

from collections.abc import Generator
from types import TracebackType

import pytest

LONG_LIMIT_S = 3600


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Give tests with the mark `long` a longer time limit than the limit in pyproject.toml."""
    for item in items:
        if item.get_closest_marker("long") and not item.get_closest_marker("timeout"):
            item.add_marker(pytest.mark.timeout(LONG_LIMIT_S))


def _with_line_numbers(traceback: TracebackType | None) -> TracebackType | None:
    """Return the traceback in which each frame has a line: without one pytest ends the whole run.

    The signal of a time limit can arrive where Python executes code that no line of the source stands for.
    """
    if traceback is None:
        return None
    line: int | None = traceback.tb_lineno
    if line is None:
        line = traceback.tb_frame.f_code.co_firstlineno
    return TracebackType(_with_line_numbers(traceback.tb_next), traceback.tb_frame, traceback.tb_lasti, line)


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_runtest_setup() -> Generator[None, object, object]:
    return (yield from _failing_alone())


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_runtest_call() -> Generator[None, object, object]:
    return (yield from _failing_alone())


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_runtest_teardown() -> Generator[None, object, object]:
    return (yield from _failing_alone())


def _failing_alone() -> Generator[None, object, object]:
    try:
        return (yield)
    except BaseException as error:
        error.__traceback__ = _with_line_numbers(error.__traceback__)
        raise
