"""What commands say besides their results, and how they end: one sentence and a status, never a traceback."""

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
"""Why lines for the standard output were lost: as global as that, and the stream itself does not remember."""


def run(command: click.Command, foreseen: tuple[type[Exception], ...], prefix: str) -> NoReturn:
    """Run a command line and exit: status 2 with one sentence for what could not be done.

    Parameters
    ----------
    command : click.Command
        Its own status, if it ends with one, is kept.
    foreseen : tuple of exception types
        Errors whose message is the sentence.
    prefix : str
        What the sentence begins with.
    """
    _prepare_streams()
    _unprinted.clear()
    with _ending_like_ctrl_c():
        status = _status(command, foreseen, prefix)
    sys.exit(_flushed(status, prefix))


def say(line: str, *, err: bool = False) -> None:
    """Print a line in the midst of work, which goes on if it cannot be printed: `run` says so at the end."""
    try:
        # By its name: click alone would write past the bar of `progress`, which stands in for both streams.
        click.echo(line, file=sys.stderr if err else sys.stdout)
    except OSError as error:
        # Whoever closed a pipe does not want the rest.
        if not err and not isinstance(error, BrokenPipeError):
            _unprinted.append(error)


def fail(sentence: str) -> None:
    """Print a sentence about what could not be done."""
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
    """Let no sign that a terminal lacks, and no stream that was closed, end a command."""
    for descriptor in range(3):
        try:
            os.fstat(descriptor)
        except OSError:
            # Otherwise the next file that is opened becomes the standard output.
            os.open(os.devnull, os.O_RDWR)
    # Python gives no stream for a descriptor that was closed.
    sys.stdout = sys.stdout or Path(os.devnull).open("w")  # noqa: SIM115
    sys.stderr = sys.stderr or Path(os.devnull).open("w")  # noqa: SIM115
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors="replace")


@contextmanager
def _ending_like_ctrl_c() -> Iterator[None]:
    """Turn signals that ask a program to end into `KeyboardInterrupt`, unless `nohup` has them ignored."""
    changed = [number for number in _ENDING if signal.getsignal(number) is signal.SIG_DFL]
    for number in changed:
        signal.signal(number, signal.default_int_handler)
    try:
        yield
    finally:
        for number in changed:
            signal.signal(number, signal.SIG_DFL)


def _flushed(status: int, prefix: str) -> int:
    """Return the status, or `COULD_NOT` if something printed was lost other than by a reader that left."""
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
    """Let the first Ctrl-C, SIGTERM or SIGHUP end a series after the image at hand, a second one at once.

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
