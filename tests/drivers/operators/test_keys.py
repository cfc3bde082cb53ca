"""Single keys are read at a pseudo-terminal, which is then as before; other input is left alone."""

import os
import pty
import select
import termios
import threading

import pytest

from drivers.terminal.keys import Keys

DEADLINE_S = 60.0


@pytest.fixture
def terminal():
    keyboard, screen = pty.openpty()
    yield keyboard, screen
    os.close(keyboard)
    os.close(screen)


@pytest.fixture
def wakes():
    read, write = os.pipe()
    yield read, write
    os.close(read)
    os.close(write)


def flags(descriptor: int) -> int:
    return termios.tcgetattr(descriptor)[3]


def test_a_key_is_read_at_once_without_an_echo_and_the_terminal_is_as_before(terminal, wakes):
    keyboard, screen = terminal
    before, found = flags(screen), []
    reading = threading.Thread(target=lambda: found.append(Keys(screen).next(wakes[0])))
    reading.start()
    while flags(screen) & termios.ICANON:
        assert reading.is_alive()
    assert flags(screen) & termios.ISIG
    os.write(keyboard, b"p")
    reading.join(DEADLINE_S)
    assert found == ["p"]
    assert flags(screen) == before
    assert select.select([keyboard], [], [], 0.0)[0] == []


def test_a_wake_up_ends_the_wait_and_leaves_the_terminal_as_before(terminal, wakes):
    before = flags(terminal[1])
    os.write(wakes[1], b"x")
    assert Keys(terminal[1]).next(wakes[0]) == ""
    assert flags(terminal[1]) == before


def test_a_pipe_is_no_terminal_and_nothing_is_read_from_it(wakes):
    read, write = os.pipe()
    os.write(write, b"p")
    os.write(wakes[1], b"x")
    keys = Keys(read)
    assert not keys.there
    assert keys.next(wakes[0]) == ""
    assert os.read(read, 1) == b"p"
    os.close(read)
    os.close(write)
    assert not keys.there
