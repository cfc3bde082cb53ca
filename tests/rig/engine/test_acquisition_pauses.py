"""Pauses and requests of a person during an acquisition: only the images wait, and the record goes on."""

import numpy as np
import pytest

from rig.commands.verify import verify_run
from rig.protocol.acquisition_tables import FirstBeyond, Level
from rig.protocol.step import RigReading
from rig.samples import SignalReading
from tests.rig.engine.fake_stream import StreamingCamera
from tests.rig.engine.test_acquisition import beside, steps, with_tables

EVERY = with_tables("every_s = 0.5", "duration_s = 10")


def at_times(rig, engine, *acts):
    """Let things happen at times of the clock, when the box is read."""
    left = sorted(acts, key=lambda act: act[0])

    def force_n(_):
        while left and rig.clock.now_s() >= left[0][0]:
            left.pop(0)[1](engine)
        return 0.0

    rig.channels["box"].force_n = force_n


@pytest.mark.parametrize("streams", [False, True])
def test_only_the_images_wait_while_a_run_is_paused(tmp_path, streams):
    rig = beside(tmp_path, EVERY)
    if streams:
        rig.cameras = {name: StreamingCamera(rig.clock) for name in rig.cameras}
    engine = rig.engine()
    at_times(rig, engine, (3.2, lambda e: e.pause("a person")), (6.2, lambda e: e.go_on("a person")))
    outcome = engine.run()
    assert outcome.is_good, outcome.timing
    assert outcome.timing.paused == 6
    assert outcome.timing.taken == 15
    assert (outcome.pauses.count, outcome.pauses.missed_steps) == (1, 0)
    columns, camera, box = steps(rig.path)
    # the images after the pause are at the times of before
    intervals = (columns["due_s"] - columns["due_s"][0]) / 0.5
    np.testing.assert_allclose(intervals, np.round(intervals), atol=1e-6)
    assert np.diff(camera["middle_s"]).max() == pytest.approx(3.5, abs=0.11)
    assert (np.diff(box["number"]) == 1).all()
    # nor does the file miss an image that nobody wanted
    assert {timing.missing for timing in verify_run(rig.path).timing.values()} == {0}
    assert not any("lost" in event for event in rig.events())


def test_a_pause_before_the_first_image(tmp_path):
    rig = beside(
        tmp_path,
        with_tables('every_s = 0.5\nbegin = { channel = "channels.force", above = 10 }', "duration_s = 4"),
    )
    engine = rig.engine()
    rig.clock.begun = False

    def force_n(t):
        now_s = rig.clock.now_s()
        if 1.0 < now_s < 1.03:
            engine.pause("a person")
        if 3.0 < now_s < 3.03:
            engine.go_on("a person")
        return 100.0 if now_s > 5.0 else 0.0

    rig.channels["box"].force_n = force_n
    outcome = engine.run()
    assert outcome.is_good
    assert outcome.timing.taken == 9
    assert outcome.pauses.count == 1


def test_an_abort_ends_a_pause(tmp_path):
    rig = beside(tmp_path, EVERY)
    engine = rig.engine()
    at_times(rig, engine, (3.2, lambda e: e.pause("a person")), (6.2, lambda e: e.abort("enough")))
    outcome = engine.run()
    assert outcome.status == "aborted"
    assert rig.clock.now_s() < 7.0


def test_requests_are_refused_where_they_make_no_sense(tmp_path):
    rig = beside(tmp_path, EVERY)
    engine = rig.engine()
    said = []
    at_times(rig, engine, (3.2, lambda e: said.append(e.request_image())), (5.1, lambda e: e.request_end()))
    assert engine.request_end() == "no images are being taken now"
    outcome = engine.run()
    assert outcome.is_good
    assert said == ["this protocol does not take images on request"]
    assert outcome.timing.taken == 11
    assert engine.request_image() == "no images are being taken now"


def test_the_first_sample_beyond_a_level_is_found_in_the_middle_of_a_block():
    first = FirstBeyond(Level(channel="channels.force", above=3.0))
    for values in ([0.0, 1.0], [2.0, 4.0, 1.0], [9.0]):
        times_s = np.array([10.0 * values[0] + k for k in range(len(values))])
        signals = {"force": SignalReading(np.array(values), times_s)}
        first.see(RigReading(0.0, signals=signals))
    assert first.time_s == 21.0
