"""Messages and exit status of commands. For an error, the command prints one sentence and no traceback."""

import logging
import os
import re
import signal
import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from io import TextIOWrapper
from pathlib import Path
from typing import Any, NoReturn

import click

from dic.errors import ImageWarning, WorkerWarning

COULD_NOT = 2
_ENDING = tuple(getattr(signal, name) for name in ("SIGTERM", "SIGHUP", "SIGBREAK") if hasattr(signal, name))
"""Signals that end a program: SIGHUP where a terminal can hang up, SIGBREAK on Windows."""
_CONTROLS = {code: f"\\x{code:02x}" for code in (*range(32), *range(127, 160)) if chr(code) not in "\n\t"}
"""Signs that could move a terminal's cursor or clear it, as they are written in Python.

Names of files may contain them.
"""
_unprinted: list[OSError] = []
"""Errors from lines that could not be printed to standard output.

Python's stream does not record these errors. This list of errors is global because the stream is global.
"""

_NO_GLYPH = re.compile(r"Glyph \d+ .*missing from")


def run(command: click.Command, foreseen: tuple[type[Exception], ...], prefix: str) -> NoReturn:
    """Run a command and exit; an expected error prints one sentence and exits with status 2.

    `command`: the command to run. If the command exits with a status of its own, the program exits with that
    status. `foreseen`: expected errors. The message of such an error is the printed sentence. `prefix`: text
    that is printed before the sentence, for example the program's name.
    """
    _prepare_streams()
    _unprinted.clear()
    with _warnings_as_lines(), _notes_as_lines():
        status = _status(command, foreseen, prefix)
    sys.exit(_flushed(status, prefix))


def say(line: str, *, err: bool = False) -> None:
    """Print a line. If printing fails, the work continues.

    At its end, the function `run` reports that lines could not be printed on standard output. If the reader
    of a pipe has closed the pipe, nothing is reported.
    """
    try:
        line = line.translate(_CONTROLS)
        # Pass the stream explicitly. The progress bar replaces both streams, and without this argument click
        # would print to the original ones.
        click.echo(line, file=sys.stderr if err else sys.stdout)
    except OSError as error:
        # If the reader of the pipe has closed it, the remaining lines are not needed.
        if not err and not isinstance(error, BrokenPipeError):
            _unprinted.append(error)


def fail(sentence: str) -> None:
    """Print a sentence about a failure to standard error."""
    say(f"error: {sentence}", err=True)


def sentence_of(error: Exception) -> str:
    """Return the sentence about an expected error, or about an error of the file system."""
    if not isinstance(error, OSError):
        return str(error)
    where = error.filename or "a file or the standard output"
    return f"{where}: {error.strerror or error}; name a place that can be used"


def _status(command: click.Command, foreseen: tuple[type[Exception], ...], prefix: str) -> int:
    try:
        # If standalone mode is off, click returns the status of `Context.exit` and raises all errors.
        with _ending_like_ctrl_c():
            return command.main(standalone_mode=False) or 0
    except SystemExit as end:
        return int(end.code or 0)
    except click.exceptions.NoArgsIsHelpError as error:
        with suppress(OSError):
            error.show()
        return error.exit_code
    except click.ClickException as error:
        context = getattr(error, "ctx", None)
        said = " ".join(error.format_message().split()).rstrip(".")
        joined = f"{said} " if said.endswith("?") else f"{said}; "
        more = "" if context is None else f"{context.command_path} --help shows how it is used"
        say(f"{prefix}: {joined if more else said}{more}", err=True)
        return error.exit_code
    except (click.Abort, KeyboardInterrupt) as error:
        # click raises its `Abort` from the `KeyboardInterrupt`, which may say how to go on.
        sentence = str(error) or str(error.__cause__ or "") or "interrupted before the end"
    except foreseen as error:
        sentence = sentence_of(error)
    except OSError as error:
        sentence = sentence_of(error)
    say(f"{prefix}: {sentence}", err=True)
    return COULD_NOT


@contextmanager
def _warnings_as_lines() -> Iterator[None]:
    """Print a warning of this package as one line, without file name and line number of the code.

    A picture shows a box for a character that its font lacks, which needs no warning.
    """
    shown = warnings.showwarning

    def show(message: Warning | str, *others: Any, **named: Any) -> None:
        if isinstance(message, ImageWarning | WorkerWarning):
            say(f"warning: {message}", err=True)
        elif not _NO_GLYPH.match(str(message)):
            shown(message, *others, **named)

    warnings.showwarning = show
    try:
        yield
    finally:
        warnings.showwarning = shown


@contextmanager
def _notes_as_lines() -> Iterator[None]:
    """Print what this package logs as lines, such as the note that code is compiled, which takes a while."""

    class Lines(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            say(record.getMessage(), err=True)

    log, lines = logging.getLogger("dic"), Lines()
    before = log.level
    log.addHandler(lines)
    log.setLevel(logging.INFO)
    try:
        yield
    finally:
        log.removeHandler(lines)
        log.setLevel(before)


def _prepare_streams() -> None:
    """Prevent errors from characters that a stream cannot encode and from closed standard streams.

    A notebook sets matplotlib's backend for its own pictures. No command shows one on a screen.
    """
    os.environ.pop("MPLBACKEND", None)
    for descriptor in range(3):
        try:
            os.fstat(descriptor)
        except OSError:
            # If the descriptor stayed free, the next opened file would take the place of the standard stream.
            os.open(os.devnull, os.O_RDWR)
    # If a standard stream was closed at the start, Python sets it to None.
    sys.stdout = sys.stdout or Path(os.devnull).open("w")  # noqa: SIM115
    sys.stderr = sys.stderr or Path(os.devnull).open("w")  # noqa: SIM115
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors="replace")


@contextmanager
def _ending_like_ctrl_c() -> Iterator[None]:
    """Make SIGTERM and SIGHUP raise `KeyboardInterrupt`, except where they are ignored, as under `nohup`.

    The signals raise this exception only while the work runs. Afterwards the signals end the program at once.
    The program may then be waiting for a terminal that accepts no output, and during such a wait Python runs
    no signal handlers.
    """
    changed = [number for number in _ENDING if signal.getsignal(number) is signal.SIG_DFL]
    for number in changed:
        signal.signal(number, signal.default_int_handler)
    try:
        yield
    finally:
        for number in changed:
            signal.signal(number, signal.SIG_DFL)


def _flushed(status: int, prefix: str) -> int:
    """Flush the output and return the exit status: the given one, or `COULD_NOT` if lines were lost.

    Lines do not count as lost if the reader of the output closed the pipe.
    """
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except OSError:
            # Python flushes the stream again when it exits and would print an error. Send that output to the
            # null device.
            os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
    if not _unprinted:
        return status
    say(f"{prefix}: standard output: {_unprinted[0].strerror}; send it elsewhere or make room", err=True)
    return COULD_NOT


def stopped_early(left: int, count: int, done: str) -> str:
    """Return the message about a series that a signal ended early; `done` is a word such as "measured"."""
    return f"stopped by a signal, {left} of {count} images not {done}"


@contextmanager
def stopping_between() -> Iterator[Callable[[], bool]]:
    """Within a `with` block, make the first Ctrl-C, SIGTERM or SIGHUP stop the work after the current image.

    A second signal stops the program at once. The `with` statement provides a function that returns True
    after the first signal; the statements in the `with` block must call this function after each image.
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
