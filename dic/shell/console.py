"""Messages and exit of commands: one sentence and a status, never a traceback."""

import os
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from io import TextIOWrapper
from pathlib import Path
from typing import NoReturn

import click

COULD_NOT = 2
_ENDING = (signal.SIGTERM, signal.SIGHUP)
_unprinted: list[OSError] = []
"""Errors of lost lines of standard output. Global like the stream, which does not record its errors."""


def run(command: click.Command, foreseen: tuple[type[Exception], ...], prefix: str) -> NoReturn:
    """Run a command line and exit; a foreseen error gives one sentence and status 2.

    Parameters
    ----------
    command : click.Command
        The command; if it exits with a status, that status is kept.
    foreseen : tuple of exception types
        Errors whose message is printed as the sentence.
    prefix : str
        Beginning of the sentence.
    """
    _prepare_streams()
    _unprinted.clear()
    with _ending_like_ctrl_c():
        status = _status(command, foreseen, prefix)
    sys.exit(_flushed(status, prefix))


def say(line: str, *, err: bool = False) -> None:
    """Print a line during work. If printing fails, work continues and `run` reports the loss at the end."""
    try:
        # Name the stream: otherwise click bypasses the bar of `progress`, which replaces both streams.
        click.echo(line, file=sys.stderr if err else sys.stdout)
    except OSError as error:
        # A reader that closed the pipe does not want the remaining lines.
        if not err and not isinstance(error, BrokenPipeError):
            _unprinted.append(error)


def fail(sentence: str) -> None:
    """Print a sentence about a failure."""
    say(f"error: {sentence}", err=True)


def _status(command: click.Command, foreseen: tuple[type[Exception], ...], prefix: str) -> int:
    try:
        # Without standalone mode, click returns the status of `Context.exit` and raises the rest.
        return command.main(standalone_mode=False) or 0
    except SystemExit as end:
        return int(end.code or 0)
    except click.ClickException as error:
        with suppress(OSError):
            error.show()
        return error.exit_code
    except (click.Abort, KeyboardInterrupt):
        sentence = "interrupted before the end"
    except foreseen as error:
        sentence = str(error)
    except OSError as error:
        where = error.filename or "a file or the standard output"
        sentence = f"{where}: {error.strerror or error}; name a place that can be used"
    say(f"{prefix}: {sentence}", err=True)
    return COULD_NOT


def _prepare_streams() -> None:
    """Prevent failures of a command from unsupported characters and closed streams."""
    for descriptor in range(3):
        try:
            os.fstat(descriptor)
        except OSError:
            # Otherwise the next opened file becomes the closed standard stream.
            os.open(os.devnull, os.O_RDWR)
    # Python sets the stream of a closed descriptor to None.
    sys.stdout = sys.stdout or Path(os.devnull).open("w")  # noqa: SIM115
    sys.stderr = sys.stderr or Path(os.devnull).open("w")  # noqa: SIM115
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors="replace")


@contextmanager
def _ending_like_ctrl_c() -> Iterator[None]:
    """Turn termination signals into `KeyboardInterrupt`, unless they are ignored (`nohup`)."""
    changed = [number for number in _ENDING if signal.getsignal(number) is signal.SIG_DFL]
    for number in changed:
        signal.signal(number, signal.default_int_handler)
    try:
        yield
    finally:
        for number in changed:
            signal.signal(number, signal.SIG_DFL)


def _flushed(status: int, prefix: str) -> int:
    """Return the status, or `COULD_NOT` if output was lost for another reason than a closed pipe."""
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except OSError:
            # Python flushes once more when it exits, and would complain.
            os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
    if not _unprinted:
        return status
    say(f"{prefix}: standard output: {_unprinted[0].strerror}; send it elsewhere or make room", err=True)
    return COULD_NOT


@contextmanager
def stopping_between() -> Iterator[Callable[[], bool]]:
    """Let the first Ctrl-C, SIGTERM or SIGHUP end a series after the current image, the second at once.

    Yields the function that tells whether to stop.
    """
    asked = False

    def handle(number: int, _: object) -> None:
        nonlocal asked
        if asked:
            raise KeyboardInterrupt
        asked = True
        say("stopping after this image", err=True)

    numbers = (signal.SIGINT, *_ENDING)
    before = {n: signal.getsignal(n) for n in numbers if signal.getsignal(n) is not signal.SIG_IGN}
    for number in before:
        signal.signal(number, handle)
    try:
        yield lambda: asked
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
