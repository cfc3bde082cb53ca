"""Runs one after the other: their files, the questions between them, and the end at the first failure."""

import json
import os
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from dic.runfile.reader import RunFile
from drivers.errors import ConfigurationError
from rig import RigError
from rig.commands.queue import QueueResult, ask_operator, execute, planned, require_places_of
from rig.commands.queue_file import read_jobs
from rig.engine.status import Outcome
from rig.resume import ContinueError, read_earlier
from tests.command_line import run_rig
from tests.rig.news.test_run_news import RIG

PROTOCOL = """
kind = "phases"
title = "a turn"
[sample]
name = "plate"
thickness_mm = 1.0
width_mm = 25.0
gauge_length_mm = 25.0
[settle]
angle_tolerance_deg = 0.01
dwell_s = 0.05
timeout_s = 20.0
[images]
still = 0
[[phases]]
do = "rotate"
angle_deg = 20.0
[[phases]]
do = "ask"
text = "Has the photograph been taken?"
"""
QUEUE = """
rig = "rig.toml"
folder = "runs"
[[runs]]
protocol = "turn.toml"
sample = { name = "S1", direction_deg = 0.0 }
[[runs]]
protocol = "turn.toml"
output = "second.h5"
text = "Please turn the sheet."
word = "turned"
[[runs]]
protocol = "turn.toml"
sample = { name = "S3", width_mm = 24.5 }
"""


@pytest.fixture
def files(tmp_path):
    (tmp_path / "rig.toml").write_text(RIG.format(real_time="false"))
    (tmp_path / "turn.toml").write_text(PROTOCOL)
    (tmp_path / "queue.toml").write_text(QUEUE)
    return tmp_path


@contextmanager
def typed(text: str) -> Iterator[None]:
    """Let the standard input be a pipe with a text."""
    before = os.dup(0)
    read, write = os.pipe()
    os.write(write, text.encode())
    os.close(write)
    os.dup2(read, 0)
    os.close(read)
    try:
        yield
    finally:
        os.dup2(before, 0)
        os.close(before)


def jobs(files, **options):
    return read_jobs([files / "queue.toml"], options.get("rig"), options.get("folder"))


def test_a_queue_file_names_runs_with_their_own_specimens(files):
    first, second, third = jobs(files)
    assert [job.output for job in (first, second, third)] == [
        files / "runs" / name for name in ("01-turn.h5", "second.h5", "03-turn.h5")
    ]
    assert first.question.text == "Please mount the specimen S1, 0 degrees to the rolling direction."
    assert (second.question.text, second.question.word) == ("Please turn the sheet.", "turned")
    assert (second.changed, second.own_protocol) == ("", files / "turn.toml")
    assert first.own_protocol == files / "runs/01-turn.protocol.toml"
    before, changed = tomllib.loads(PROTOCOL), tomllib.loads(third.changed)
    assert changed.pop("sample") == before.pop("sample") | {"name": "S3", "width_mm": 24.5}
    assert changed == before


def test_all_runs_are_executed_and_each_states_its_specimen(files):
    done = run_rig("queue", files / "queue.toml", "--json", files / "queue.json")
    assert done.status == 0, done.err
    assert "simulated operator: Please turn the sheet." in done.out
    assert "3 of 3 runs completed" in done.out
    table = json.loads((files / "queue.json").read_text())
    assert table["completed"] == 3
    assert [run["status"] for run in table["runs"]] == ["completed"] * 3
    stated = []
    for run in table["runs"]:
        with RunFile(run["run_file"]) as file:
            stated.append((file.info.sample, file.info.width_mm, file.info.direction_deg))
    assert stated == [("S1", 25.0, 0.0), ("plate", 25.0, None), ("S3", 24.5, None)]
    # the run's own protocol lies beside it, so that a run which ended early can go on
    own = (files / "runs/01-turn.protocol.toml").read_text()
    with pytest.raises(ContinueError, match="got a completed one"):
        read_earlier(files / "runs/01-turn.h5", own, "")
    again = run_rig("queue", files / "queue.toml")
    assert again.status == 2
    assert "expected a new file" in again.err
    assert "begin with a later run with --from" in again.err


def test_protocols_get_numbered_run_files_and_a_plan_opens_nothing(files):
    arguments = ("queue", files / "turn.toml", files / "turn.toml", "--rig", files / "rig.toml")
    done = run_rig(*arguments, "-o", files / "out", "--plan", "--json", files / "plan.json")
    assert done.status == 0, done.err
    assert "2 runs, about " in done.out
    assert not (files / "out").exists()
    table = json.loads((files / "plan.json").read_text())
    assert [run["run_file"] for run in table["runs"]] == [str(files / f"out/{n:02d}-turn.h5") for n in (1, 2)]
    assert [step["kind"] for step in table["runs"][0]["plan"]["steps"]][-1] == "ask"
    later = run_rig(*arguments, "--from", 3, "--plan")
    assert later.status == 2
    assert "--from 3 is beyond the 2 runs" in later.err


def test_a_plan_tells_what_the_rig_cannot_do(files):
    (files / "turn.toml").write_text(PROTOCOL.replace("angle_deg = 20.0", "angle_deg = 400.0"))
    done = run_rig("queue", files / "queue.toml", "--plan")
    assert done.status == 1
    assert "not on this rig: run 3, " in done.out
    with pytest.raises(RigError, match="got 6 objections"):
        require_places_of(planned(jobs(files)))


@pytest.mark.parametrize("end", ["aborted", "failed", "refused", "interrupted", "completed"])
def test_the_first_run_that_is_not_completed_or_lacks_samples_ends_the_queue(files, end):
    (files / "runs").mkdir()
    begun = []

    def run(job):
        begun.append(job.number)
        if job.number == 1:
            return Outcome("completed", "", 3)
        if end == "refused":
            raise RigError("the disk", "room", "none", "free it")
        if end == "interrupted":
            raise KeyboardInterrupt
        if end == "completed":
            return Outcome("completed", "", 3, lost_samples={"box": 2})
        return Outcome(end, "the lamp is out", 1)

    results = list(execute(jobs(files), lambda job: None, run))
    assert begun == [1, 2]
    assert all(isinstance(result, QueueResult) for result in results)
    told = "refused" if end == "interrupted" else end
    assert [result.status for result in results] == ["completed", told, "not begun"]
    assert results[1].reason
    assert "not begun" in results[2].line()


def test_a_person_is_asked_between_the_runs_of_a_real_rig(files):
    virtual = (files / "rig.toml").read_text()
    operator = '[operator]\ndriver = "console-operator"\n'
    tables = virtual.split("[simulation]")[0] + virtual.split("real_time = false")[1].split("[operator]")[0]
    (files / "real.toml").write_text((tables + operator).replace("@stage_tcp", "127.0.0.1:1"))
    arguments = ("queue", files / "turn.toml", "--rig", files / "real.toml", "-o", files / "out")
    with typed("no\nmounted\n"):
        done = run_rig(*arguments)
    # the word was accepted, and then the rig could not be opened
    assert "Please mount the specimen plate." in done.err
    assert '"no" is not the word. Type mounted when it is done' in done.err
    assert "@" not in done.err
    assert done.status == 2
    assert "1  " in done.out
    assert ": refused, " in done.out
    with typed(""):
        unanswered = run_rig(*arguments)
    assert unanswered.status == 2
    assert 'expected the word "mounted", got no answer' in unanswered.out
    told = []
    [job] = read_jobs([files / "turn.toml"], files / "rig.toml", None)
    ask_operator(job, told.append)
    assert told == ["simulated operator: Please mount the specimen plate."]


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('rig = "rig.toml"', "", "no rig file is named; give --rig"),
        ("folder", "folders", "folders: unknown key"),
        ('output = "second.h5"', 'output = "01-turn.h5"', "01-turn.h5 is the output of two runs"),
        ('word = "turned"', 'word = "two words"', "runs.1.word: string should match pattern"),
        ("width_mm = 24.5", "with_mm = 24.5", "runs.2.sample.with_mm: unknown key"),
        ("width_mm = 24.5", "width_mm = -1.0", "run 3, "),
        (
            "direction_deg = 0.0",
            "direction_deg = 180.0",
            "sample.direction_deg: input should be less than 180",
        ),
        ('protocol = "turn.toml"', 'protocol = "gone.toml"', "gone.toml"),
    ],
)
def test_mistakes_of_a_queue_are_told_before_anything_moves(files, old, new, said):
    (files / "queue.toml").write_text(QUEUE.replace(old, new, 1))
    with pytest.raises(ConfigurationError) as caught:
        planned(jobs(files))
    assert said in str(caught.value)


def test_an_empty_queue_and_one_of_no_runs_are_mistakes(files):
    (files / "queue.toml").write_text("runs = []\n")
    with pytest.raises(ConfigurationError, match="runs: list should have at least 1 item"):
        jobs(files)
