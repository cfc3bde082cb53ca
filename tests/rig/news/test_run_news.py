"""The news of whole runs (files, message and HTTP together), however the run ends."""

import json
import signal
import socket
from contextlib import closing
from http.client import HTTPConnection
from pathlib import Path

import pytest

from rig.errors import ProtocolError, RecordingError
from rig.news.run_news import NewsOptions
from rig.run import run_protocol

RIG = """
[rig]
name = "small rig"
[simulation]
driver = "virtual-rig"
real_time = {real_time}
[stage]
driver = "zaber-ascii"
port = "@stage_tcp"
angle_min_deg = -5.0
angle_max_deg = 365.0
speed_deg_s = 20.0
[cameras.front]
driver = "simulated-camera"
width_px = 48
height_px = 32
[operator]
driver = "simulated-operator"
duration_s = 0.0
"""
PROTOCOL = """
kind = "rotation"
title = "many turns"
[sample]
name = "plate"
thickness_mm = 1.0
width_mm = 25.0
gauge_length_mm = 25.0
[rotation]
increment_deg = 10.0
total_deg = {total_deg}
[settle]
angle_tolerance_deg = 0.01
dwell_s = 0.05
timeout_s = 20.0
poll_s = 0.05
[images]
still = 0
"""


@pytest.fixture
def files(tmp_path) -> Path:
    """A folder with the files of a run that takes minutes of real time, and a command that logs its calls."""
    (tmp_path / "rig.toml").write_text(RIG.format(real_time="true"))
    (tmp_path / "virtual.toml").write_text(RIG.format(real_time="false"))
    (tmp_path / "long.toml").write_text(PROTOCOL.format(total_deg=360.0))
    (tmp_path / "short.toml").write_text(PROTOCOL.format(total_deg=20.0))
    note = tmp_path / "note"
    note.write_text(f"#!/bin/sh\necho \"$1\" >> '{tmp_path}/notes'\n")
    note.chmod(0o755)
    return tmp_path


def begun(start, files: Path):
    program = start(
        *("run", files / "long.toml", "--rig", files / "rig.toml", "-o", files / "run.h5"),
        *("--http", "0", "--notify", f"'{files}/note' {{subject}}"),
    )
    program.wait_for("step 2 (rotation 10 deg)")
    return program


def notes(files: Path) -> list[str]:
    return (files / "notes").read_text().splitlines()


def events(files: Path) -> list[dict]:
    return [json.loads(line) for line in (files / "run.events.jsonl").read_text().splitlines()]


def heartbeat(files: Path) -> dict:
    return json.loads((files / "run.heartbeat.json").read_text())


def test_a_run_is_watched_and_aborted_by_http(start, files):
    program = begun(start, files)
    line = next(line for line in program.process.stderr if "Bearer" in line)
    token = line.split("Bearer ")[1].split("'")[0]
    place = heartbeat(files)["http"].split("/")[2]
    with closing(HTTPConnection(place, timeout=60.0)) as http:

        def ask(method: str, path: str, **headers: str):
            http.request(method, path, headers=headers)
            answer = http.getresponse()
            return answer.status, answer.read()

        status = json.loads(ask("GET", "/v1/status")[1])
        assert (status["simulated"], status["steps_planned"]) == (True, 38)
        assert status["state"] in ("moving", "imaging")
        assert ask("GET", "/v1/cameras/front/thumbnail.png")[1].startswith(b"\x89PNG")
        assert ask("POST", "/v1/abort")[0] == 401
        allowed = {"Authorization": f"Bearer {token}"}
        assert ask("POST", "/v1/answer?word=done", **allowed)[0] == 409
        assert ask("POST", "/v1/continue", **allowed)[0] == 409
        assert ask("POST", "/v1/pause?reason=lamp", **allowed)[0] == 202
        while json.loads(ask("GET", "/v1/status")[1])["state"] != "paused":
            assert json.loads(ask("GET", "/v1/status")[1])["outcome"] is None
        assert ask("POST", "/v1/continue", **allowed)[0] == 202
        while json.loads(ask("GET", "/v1/status")[1])["pause_requested"]:
            pass
        assert ask("POST", "/v1/pause", **allowed)[0] == 202
        path = "/v1/abort?reason=smoke"
        assert ask("POST", path, Authorization=f"Bearer {token}")[0] == 202
    status, complaints = program.end()
    assert status == 1
    assert "an abort by HTTP: smoke" in complaints
    assert notes(files) == ["SIMULATED aborted: many turns"]
    assert heartbeat(files)["status"] == "aborted"
    found = events(files)
    assert [event["n"] for event in found] == list(range(1, len(found) + 1))
    assert (found[0]["event"], found[-1]["event"]) == ("started", "ended")
    assert all(event["simulated"] for event in found)
    assert "paused" in [event.get("state") for event in found]
    said = [event["message"] for event in found if event["event"] == "log"]
    assert any(message.startswith("paused in step ") and "by HTTP: lamp" in message for message in said)
    assert any(message.startswith("goes on by HTTP after ") for message in said)


@pytest.mark.extended
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_gives_one_message(start, files, number):
    program = begun(start, files)
    program.process.send_signal(number)
    assert program.end()[0] == 1
    assert notes(files) == ["SIMULATED aborted: many turns"]
    assert events(files)[-1]["status"] == "aborted"


def test_the_numbers_of_the_events_tell_the_steps_in_order(files):
    outcome = run_protocol(files / "short.toml", files / "virtual.toml", files / "run.h5")
    assert (outcome.status, outcome.lost_listeners) == ("completed", ())
    found = events(files)
    done = [event["step"]["index"] for event in found if event["event"] == "step"]
    assert done == [0, 1, 2, 3]
    # A step is told after its states and before those of the next step.
    order = [event["step"]["index"] for event in found if event["event"] in ("state", "step")]
    assert order == sorted(order)
    assert heartbeat(files)["ended"]


def test_a_client_that_reads_nothing_holds_up_nothing(files):
    lines = []
    clients = []

    def connect(line: str) -> None:
        lines.append(line)
        if "status" in line:
            port = int(line.split(":")[3].split("/")[0])
            client = socket.create_connection(("127.0.0.1", port), 60.0)
            client.sendall(f"GET /v1/events HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\n\r\n".encode())
            clients.append(client)

    news = NewsOptions(http=0, say=connect)
    outcome = run_protocol(files / "short.toml", files / "virtual.toml", files / "run.h5", news=news)
    for client in clients:
        client.close()
    assert lines[0].startswith("SIMULATED HTTP: http://127.0.0.1:")
    assert len(clients) == 1
    assert (outcome.status, outcome.lost_listeners) == ("completed", ())


def test_a_failing_command_changes_nothing_but_is_said(files):
    news = NewsOptions(notify="sh -c 'echo no server; exit 7'")
    outcome = run_protocol(files / "short.toml", files / "virtual.toml", files / "run.h5", news=news)
    assert outcome.status == "completed"
    assert outcome.lost_listeners == ("the command of notify, sh: ended with status 7: no server",)


def test_the_rig_file_may_name_the_command(files):
    rig_file = files / "virtual.toml"
    rig_file.write_text(rig_file.read_text() + f'[news]\nnotify = "{files}/note {{subject}}"\n')
    run_protocol(files / "short.toml", rig_file, files / "run.h5")
    assert notes(files) == ["SIMULATED completed: many turns"]


def test_a_run_that_cannot_begin_sends_nothing_and_leaves_nothing(files):
    news = NewsOptions(notify="no-such-program-of-ours")
    with pytest.raises(ProtocolError, match="not found"):
        run_protocol(files / "short.toml", files / "virtual.toml", files / "run.h5", news=news)
    assert not list(files.glob("run*"))
    (files / "run.heartbeat.json").mkdir()
    news = NewsOptions(notify=f"{files}/note again", http=0)
    with pytest.raises(RecordingError, match="a folder"):
        run_protocol(files / "short.toml", files / "virtual.toml", files / "run.h5", news=news)
    assert not (files / "notes").exists()
    assert not (files / "run.h5").exists()
