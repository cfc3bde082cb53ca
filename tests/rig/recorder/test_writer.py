"""The writer's thread collects readings, but writes at once the data for which the engine waits."""

import threading

import pytest

from drivers.clock import SystemClock, VirtualClock
from rig.recorder.writer import WriteJob, Writer
from rig.recording import RecordingSettings

PATIENCE_S = 60.0
NEVER_S = 3600.0


class Rows:
    """Replaces the run file, and records the rows of each commit in memory."""

    def __init__(self):
        self.commits = [[]]
        self.written = threading.Event()
        self.synchronised = 0

    def require_space(self, size):
        pass

    def require_untouched(self):
        pass

    def commit(self):
        self.commits.append([])
        self.written.set()

    def synchronise(self):
        self.synchronised += 1


@pytest.fixture
def start():
    """A function `start(gather_s, clock)` that returns a file in memory and its writer."""
    writers = []

    def begin(gather_s, clock=None):
        rows = Rows()
        settings = RecordingSettings(sync_s=PATIENCE_S)
        writer = Writer(rows, settings, clock or SystemClock(), lambda what, error: error, gather_s)
        writer.start()
        writers.append(writer)
        return rows, writer

    yield begin
    for writer in writers:
        writer.end(lambda: None).result(PATIENCE_S)
        writer.join(PATIENCE_S)


def reading(row):
    return WriteJob("a reading", lambda file: file.commits[-1].append(row))


def image(row):
    return WriteJob("an image", lambda file: file.commits[-1].append(row), camera="front")


def step(row):
    return WriteJob("a step", lambda file: file.commits[-1].append(row), wait_for_disk=True)


@pytest.mark.parametrize("urgent", [image, step])
def test_readings_are_written_with_the_image_or_step_that_follows(start, urgent):
    rows, writer = start(NEVER_S)
    followed = urgent(3)
    for job in (reading(0), reading(1), reading(2), followed):
        assert writer.put(job)
    followed.done.result(PATIENCE_S)
    assert rows.commits == [[0, 1, 2, 3], []]


def test_eight_readings_are_written_together_without_an_image(start):
    rows, writer = start(NEVER_S)
    jobs = [reading(row) for row in range(8)]
    for job in jobs:
        assert writer.put(job)
    jobs[-1].done.result(PATIENCE_S)
    assert rows.commits == [[*range(8)], []]


def test_a_lone_reading_is_written_without_anything_that_follows(start):
    rows, writer = start(0.001)
    assert writer.put(reading(0))
    assert rows.written.wait(PATIENCE_S)
    assert rows.commits[0] == [0]


def test_the_end_of_the_file_waits_for_no_more_readings(start):
    rows, writer = start(NEVER_S)
    assert writer.put(reading(0))
    writer.end(lambda: None).result(PATIENCE_S)
    assert rows.commits == [[0], []]


def test_images_of_a_step_after_a_pause_are_synchronised_once_with_their_step(start):
    clock = VirtualClock()
    rows, writer = start(NEVER_S, clock)
    for number in range(1, 4):
        clock.sleep(2 * PATIENCE_S)
        jobs = [image(0), image(1), step(2)]
        for job in jobs:
            assert writer.put(job)
            job.done.result(PATIENCE_S)  # so that no batch has more than one of them
        assert rows.synchronised == number


def test_images_are_synchronised_when_the_first_of_them_has_waited_long_enough(start):
    clock = VirtualClock()
    rows, writer = start(NEVER_S, clock)
    for number, synchronised in enumerate((0, 0, 1)):
        job = image(number)
        assert writer.put(job)
        job.done.result(PATIENCE_S)
        assert rows.synchronised == synchronised
        clock.sleep(PATIENCE_S / 2)
