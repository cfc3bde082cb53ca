"""The guardian reacts correctly to signs of progress and to their absence."""

import os
from collections.abc import Iterator

import pytest

from rig.guardian import messages
from rig.guardian.process import GuardedRun, watch

NO_PROGRESS = "the run made no progress for 0.05 s"


@pytest.fixture
def pipe() -> Iterator[tuple[int, int]]:
    reading, writing = os.pipe()
    yield reading, writing
    for descriptor in (reading, writing):
        try:
            os.close(descriptor)
        except OSError:
            continue


def job(**changes: object) -> GuardedRun:
    return GuardedRun(
        **{"machines": [], "patience_s": 0.05, "standing_patience_s": 0.1, "log": "", "locks": []} | changes
    )


def judged(pipe: tuple[int, int], *signs: bytes, closed: bool = False, **changes: object) -> str:
    reading, writing = pipe
    os.write(writing, b"".join(signs))
    if closed:
        os.close(writing)
    return watch(reading, job(**changes), lambda: None)


def test_a_run_that_is_done_ends_it_quietly(pipe):
    assert judged(pipe, messages.MOVING, messages.DONE) == ""


def test_the_end_of_the_pipe_without_a_word_is_the_death_of_the_run(pipe):
    assert judged(pipe, messages.STANDING, closed=True) == "the process of the run is gone"


def test_without_progress_in_motion_its_patience_ends(pipe):
    assert judged(pipe, messages.MOVING) == NO_PROGRESS


def test_while_everything_stands_it_has_more_patience(pipe):
    assert judged(pipe, messages.MOVING, messages.STANDING) == "the run made no progress for 0.1 s"


def test_being_asked_whether_it_is_there_is_no_progress(pipe):
    answers = []
    reading, writing = pipe
    os.write(writing, messages.MOVING + messages.PING)
    assert watch(reading, job(), lambda: answers.append("alive")) == NO_PROGRESS
    assert answers == ["alive"]


def test_while_a_person_is_asked_no_reading_is_due(pipe):
    reading, writing = pipe
    os.write(writing, messages.MOVING + messages.WAITING)

    def answer() -> None:
        os.write(writing, messages.DONE)

    os.write(writing, messages.PING)
    assert watch(reading, job(patience_s=0.0, standing_patience_s=0.0), answer) == ""


def test_the_death_of_the_run_is_seen_though_another_process_has_its_end_of_the_pipe(pipe):
    parent, end = os.pipe()
    os.close(end)
    try:
        assert watch(pipe[0], job(), lambda: None, parent) == "the process of the run is gone"
    finally:
        os.close(parent)
