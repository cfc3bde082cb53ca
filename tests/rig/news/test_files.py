"""The file of events and the heartbeat have the right content, and no reader or disk delays a run."""

import json
import os
from pathlib import Path

import pytest

from rig.errors import RecordingError
from rig.news.bulletin import KEPT_EVENTS, Bulletin
from rig.news.files import EventFile, Heartbeat
from rig.news.wording import About

ABOUT = About("run-1", "/data/run.h5", "A test", "tension", True, ("left",))


@pytest.fixture
def bulletin() -> Bulletin:
    return Bulletin(ABOUT)


def lines(path: Path) -> list[dict]:
    return [json.loads(line) for line in path.read_text().splitlines()]


def test_every_event_is_one_line_with_version_number_and_mark(bulletin, tmp_path):
    file = EventFile(tmp_path / "run.events.jsonl", bulletin)
    file.start()
    bulletin.add({"event": "log", "message": "one\ntwo"})
    bulletin.add({"event": "ended"})
    bulletin.close()
    assert file.finish(10.0) == []
    found = lines(file.path)
    assert [(line["v"], line["n"], line["run"], line["simulated"]) for line in found] == [
        (1, 1, "run-1", True),
        (1, 2, "run-1", True),
    ]
    assert found[0]["message"] == "one\ntwo"


def test_an_earlier_file_of_events_is_continued(bulletin, tmp_path):
    path = tmp_path / "run.events.jsonl"
    path.write_text('{"event": "of an earlier run"}\n')
    file = EventFile(path, bulletin)
    file.start()
    bulletin.add({"event": "ended"})
    bulletin.close()
    assert file.finish(10.0) == []
    assert [line["event"] for line in lines(path)] == ["of an earlier run", "ended"]


@pytest.mark.parametrize("kind", ["folder", "pipe", "link", "no folder"])
def test_what_is_no_file_is_refused_before_the_run(bulletin, tmp_path, kind):
    path = tmp_path / "run.events.jsonl"
    if kind == "folder":
        path.mkdir()
    elif kind == "pipe":
        os.mkfifo(path)
    elif kind == "link":
        path.symlink_to(tmp_path / "other")
    else:
        path = tmp_path / "nowhere" / "run.events.jsonl"
    with pytest.raises(RecordingError, match="move it away"):
        EventFile(path, bulletin)
    if kind != "no folder":
        with pytest.raises(RecordingError, match="move it away"):
            Heartbeat(path, dict)


def test_a_full_disk_is_said(bulletin, tmp_path):
    file = EventFile(tmp_path / "run.events.jsonl", bulletin)
    file._file.close()
    file._file = open("/dev/full", "ab", buffering=0)  # noqa: PTH123, SIM115
    file.start()
    bulletin.add({"event": "log"})
    [said] = file.finish(10.0)
    assert "No space left on device; it is not written any more" in said


def test_a_reader_that_is_far_behind_is_told_what_it_missed(bulletin):
    for place in range(KEPT_EVENTS + 25):
        bulletin.add({"event": "log", "place": place})
    gap, first, *_ = bulletin.since(5)
    assert (gap["event"], gap["missed"], gap["n"]) == ("gap", 20, 25)
    assert (first["n"], first["place"]) == (26, 25)
    assert bulletin.since(bulletin.last) == []
    assert len(bulletin.since(100)) == 1000
    assert bulletin.since(bulletin.last + 7) == []


def test_no_event_follows_the_end(bulletin):
    bulletin.add({"event": "ended"})
    bulletin.close()
    bulletin.add({"event": "log"})
    assert [event["event"] for event in bulletin.since(0)] == ["ended"]


def test_the_heartbeat_is_replaced_whole_and_ends_with_the_last_state(tmp_path):
    state = {"state": "moving"}
    heartbeat = Heartbeat(tmp_path / "run.heartbeat.json", lambda: dict(state))
    heartbeat.start()
    heartbeat.beat()
    state["state"] = "completed"
    heartbeat.end()
    assert heartbeat.finish(10.0) == []
    found = json.loads(heartbeat.path.read_text())
    assert (found["state"], found["pid"]) == ("completed", os.getpid())
    assert found["utc"].endswith("Z")
    assert [path.name for path in tmp_path.iterdir()] == ["run.heartbeat.json"]


def test_a_run_that_makes_no_progress_has_no_heartbeat(tmp_path):
    """A heartbeat from a separate thread would report a hanging run as alive."""
    beats = []
    heartbeat = Heartbeat(tmp_path / "run.heartbeat.json", lambda: beats.append(1) or {})
    heartbeat.start()
    heartbeat.beat()
    heartbeat.finish(1.5)
    assert len(beats) == 1
    heartbeat.end()
    heartbeat.finish(10.0)
    assert len(beats) == 2
