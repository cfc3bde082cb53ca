"""Commands end with the right status if their output is lost or if they are interrupted."""

import io
import os
import signal
import sys

import click
import pytest

from dic.shell.console import run, say, stopping_between


class Foreseen(Exception):
    pass


def ended(work):
    @click.command()
    def command() -> None:
        work()

    arguments, sys.argv = sys.argv, ["command"]
    try:
        with pytest.raises(SystemExit) as end:
            run(command, (Foreseen,), "error")
    finally:
        sys.argv = arguments
    return end.value.code


def raising(error):
    def work():
        raise error

    return work


@pytest.mark.parametrize(
    ("work", "sentence"),
    [
        (raising(Foreseen("a.png: is no image")), "error: a.png: is no image\n"),
        (raising(FileNotFoundError(2, "No such file or directory", "x/y")), "error: x/y: No such file"),
        (raising(KeyboardInterrupt()), "error: interrupted"),
        (lambda: signal.raise_signal(signal.SIGTERM), "error: interrupted"),
        (lambda: signal.raise_signal(signal.SIGHUP), "error: interrupted"),
    ],
)
def test_what_could_not_be_done_is_one_sentence_and_status_2(work, sentence, capsys):
    assert ended(work) == 2
    printed = capsys.readouterr().err
    assert sentence in printed
    assert len(printed.strip().splitlines()) == 1


def test_a_status_of_the_command_is_kept():
    assert ended(lambda: sys.exit(1)) == 1
    assert ended(lambda: click.get_current_context().exit(1)) == 1
    assert ended(lambda: None) == 0


def test_a_terminal_without_our_signs_gets_others(monkeypatch):
    raw = io.BytesIO()
    monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(raw, encoding="latin-1"))
    assert ended(lambda: say("1.5 µε – 3")) == 0
    assert raw.getvalue() == "1.5 µ? ? 3\n".encode("latin-1")


def test_a_reader_that_leaves_does_not_stop_the_work(monkeypatch):
    reader, writer = os.pipe()
    os.close(reader)
    done = []
    with os.fdopen(writer, "w") as stream:
        monkeypatch.setattr(sys, "stdout", stream)
        assert ended(lambda: (say("one"), say("two"), done.append(True))) == 0
    assert done == [True]


def test_output_lost_on_a_full_disk_is_complained_of_once_after_the_work(monkeypatch, capsys):
    done = []
    with open("/dev/full", "w", encoding="utf-8") as full:  # noqa: PTH123
        monkeypatch.setattr(sys, "stdout", full)
        assert ended(lambda: (say("one"), say("two"), done.append(True))) == 2
    assert done == [True]
    assert capsys.readouterr().err.count("standard output: No space left on device") == 1


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_the_first_signal_asks_a_series_to_stop_and_the_second_breaks_it(number):
    before = signal.getsignal(number)
    with stopping_between() as stopped:
        assert not stopped()
        signal.raise_signal(number)
        assert stopped()
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(number)
    assert signal.getsignal(number) is before


def test_signs_that_command_a_terminal_are_shown_and_not_sent(capsys):
    say("error: a\x1b]0;owned\x07\x9b2J\r.png: µ ± ✓\n  next")
    assert capsys.readouterr().out == "error: a\\x1b]0;owned\\x07\\x9b2J\\x0d.png: µ ± ✓\n  next\n"
