"""What a run tells as JSON is read back as it was, by a program that knows nothing else of the run."""

import json
import math

import pytest

from rig.commands.progress import what_happens
from rig.engine.status import EngineStatus, State
from rig.engine.timing import TimingNow
from rig.errors import RigError
from rig.news import wording
from rig.news.told import told_run
from rig.news.wording import About
from rig.protocol.step import ProtocolStep, RigReading
from tests.rig.commands.live_runs import live_now, live_status

ABOUT = About("run-1", "/data/run.h5", "A test", "tension", True, ("left",))
GRID = ProtocolStep(0, "grid")
TURNS = RigReading(1.0, angle_deg=0.5, moving=True)
ACQUIRED = ProtocolStep(3, "acquired", acquisition=object())
TIMING = TimingNow(12, 11, 1, 1, None, 0.5, math.nan)


def told(of: EngineStatus, **more: object):
    """Return what a reader gets: the object goes through JSON text."""
    table = {**wording.head(ABOUT), **wording.status_table(of), "run_file": "/data/run.h5", **more}
    return told_run(json.loads(json.dumps(table, allow_nan=False)), "run.heartbeat.json")


@pytest.mark.parametrize(
    "status",
    [
        live_status(live_now(0.004, lost=2)),
        live_status(None),
        EngineStatus(State.IDLE, None, 3, 0, None, simulated=True),
        EngineStatus(
            State.PREPARING, GRID, 3, 0, RigReading(1.0, angle_deg=0.5, moving=True), simulated=True
        ),
        EngineStatus(State.SAFING, GRID, 3, 0, RigReading(1.0, 5.0, 0.1), simulated=True),
        EngineStatus(
            State.IMAGING,
            ACQUIRED,
            3,
            1,
            RigReading(1.0, 5.0),
            simulated=True,
            acquisition=TIMING,
            load_is_measured=True,
        ),
    ],
)
def test_a_reader_sees_the_same_line_and_the_same_numbers(status):
    found = told(status).status
    assert what_happens(found) == what_happens(status)
    assert (found.steps_finished, found.steps_planned, found.simulated) == (
        status.steps_finished,
        status.steps_planned,
        True,
    )
    assert (found.reading is None) == (status.reading is None)
    if status.live is not None:
        assert found.live.reading == status.live.reading
        assert (found.live.recorded, found.live.lost, found.live.left_out) == (1234, 2, 5)
        assert (found.live.frames_per_s, found.live.values_per_s) == (10.0, 98.7)
        for name, points in status.live.curves.items():
            assert found.live.curves[name] == [pytest.approx(point, rel=1e-5) for point in points]
    assert (found.live is None) == (status.live is None)


def test_a_reader_learns_of_an_unknown_value_and_how_the_run_ended():
    run = told(live_status(None), running_s=None, status="aborted", reason="smoke", stale_after_s=None)
    assert math.isnan(run.status.reading.load_n)
    assert math.isnan(run.running_s)
    assert (run.ended, run.reason, run.stale_after_s) == ("aborted", "smoke", math.inf)


def test_the_event_of_a_new_state_has_the_newest_values_and_no_curves():
    event = wording.state_changed(live_status(live_now(0.004)))
    assert event["live"]["reading"]["gauges"]["axial"]["strain"] == 0.004
    assert event["live"]["curves"] == {}


@pytest.mark.parametrize("table", [None, [], "text", {}, {"v": 2}, {"v": "1"}])
def test_what_is_not_told_by_a_run_is_refused(table):
    with pytest.raises(RigError, match="expected the news of a run, version 1"):
        told_run(table, "other.json")


@pytest.mark.parametrize("key", ["state", "step", "steps_planned", "steps_done"])
def test_news_without_a_key_are_one_sentence(key):
    table = {**wording.head(ABOUT), **wording.status_table(live_status(live_now(0.1)))}
    for wrong in ({name: value for name, value in table.items() if name != key}, {**table, key: ["x"]}):
        with pytest.raises(RigError, match="expected the keys of the news of a run") as refused:
            told_run(wrong, "run.heartbeat.json")
        assert "\n" not in str(refused.value)
