"""The progress bar appears on a terminal only, and never covers printed lines or a question."""

import os
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from dic.shell.console import say
from dic.shell.progress import progress

MARK = "<so far>"


class Terminal:
    """A pseudo-terminal that replaces standard error after a call of `attach`."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self._monkeypatch = monkeypatch
        self._ours, theirs = os.openpty()
        self.stream = os.fdopen(theirs, "w")

    def attach(self) -> None:
        """Replace standard error; call this within the test, because pytest resets streams after fixtures."""
        self._monkeypatch.setattr(sys, "stderr", self.stream)
        self._monkeypatch.setenv("TERM", "xterm")

    def shown(self) -> str:
        """Return what was drawn since the last call."""
        # A terminal passes text on in order, but with a delay, so read up to a mark.
        self.stream.write(MARK)
        self.stream.flush()
        drawn = b""
        while not drawn.endswith(MARK.encode()):
            drawn += os.read(self._ours, 65536)
        return drawn.decode().removesuffix(MARK)

    def close(self) -> None:
        self.stream.close()
        os.close(self._ours)


@pytest.fixture
def terminal(monkeypatch) -> Iterator[Terminal]:
    made = Terminal(monkeypatch)
    yield made
    made.close()


def test_what_is_done_and_how_much_of_it_stands_on_the_terminal(terminal):
    terminal.attach()
    with progress("correlating") as bar:
        bar.expect(7)
        bar.advance()
        bar.advance()
        bar.hide()
    drawn = terminal.shown()
    assert "correlating" in drawn
    assert "2/7" in drawn


def test_lines_for_a_file_reach_the_file_and_not_the_terminal(terminal, monkeypatch, tmp_path):
    terminal.attach()
    with (tmp_path / "out").open("w") as out:
        monkeypatch.setattr(sys, "stdout", out)
        with progress("correlating", 2):
            say("image 1: done")
    assert (tmp_path / "out").read_text() == "image 1: done\n"
    assert "image 1" not in terminal.shown()


def test_lines_for_the_terminal_stand_above_the_bar_and_not_behind_it(terminal, monkeypatch):
    terminal.attach()
    monkeypatch.setattr(sys, "stdout", terminal.stream)
    with progress("correlating", 2):
        terminal.shown()
        say("image 1: done")
        say("image 2: short of speckles", err=True)
        drawn = terminal.shown()
    cleared = "\r\x1b[2K"
    assert f"{cleared}image 1: done\r\n" in drawn
    assert f"{cleared}image 2: short of speckles\r\n" in drawn


def test_nobody_draws_while_the_bar_is_hidden(terminal):
    terminal.attach()
    with progress("running", 2) as bar:
        assert sys.stderr is not terminal.stream
        bar.hide()
        terminal.shown()
        assert sys.stderr is terminal.stream
        bar.describe("asking", 1)
        bar.hide()
        assert terminal.shown() == ""
        bar.show()
        bar.hide()
        assert "asking" in terminal.shown()


def test_nothing_is_drawn_where_there_is_no_terminal(monkeypatch, tmp_path):
    place = Path(tmp_path / "err")
    with place.open("w") as err:
        monkeypatch.setattr(sys, "stderr", err)
        with progress("correlating", 1) as bar:
            bar.expect(3)
            bar.advance()
            bar.describe("more", 2)
            bar.hide()
            bar.show()
    assert place.read_text() == ""


@pytest.mark.parametrize("kind", ["dumb", "unknown"])
def test_nothing_is_drawn_on_a_terminal_that_cannot_move_its_cursor(terminal, monkeypatch, kind):
    terminal.attach()
    monkeypatch.setenv("TERM", kind)
    with progress("correlating", 1):
        say("image 1: done", err=True)
    assert terminal.shown() == "image 1: done\r\n"


def test_nothing_is_drawn_where_a_pipe_may_lead_to_the_same_terminal(terminal, monkeypatch):
    """As in `dic correlate … | tee log`: what comes out of the pipe would stand behind the bar."""
    terminal.attach()
    reader, writer = os.pipe()
    with os.fdopen(reader) as piped, os.fdopen(writer, "w") as out:
        monkeypatch.setattr(sys, "stdout", out)
        with progress("correlating", 1) as bar:
            say("image 1: done")
            bar.advance()
        assert piped.readline() == "image 1: done\n"
    assert terminal.shown() == ""


def test_long_line_above_the_bar_is_not_broken_by_a_line_feed(terminal, monkeypatch):
    terminal.attach()
    path = "a folder with a long name/" * 8 + "image.png"
    with progress("correlating", 1):
        say(path, err=True)
    assert f"{path}\r\n" in terminal.shown()
