"""`rig watch` shows what a run tells, says what silence means, and never touches the run."""

import json
import os
import socket
import subprocess
import sys
from collections.abc import Iterator
from datetime import timedelta
from pathlib import Path
from typing import Any

import pytest

from drivers.clock import VirtualClock
from rig.commands.news_sources import FileSource, HttpSource, find_source
from rig.commands.watching import TOLD_EVERY_S, Watch
from rig.news import wording
from rig.news.bulletin import Bulletin, text_of
from rig.news.wording import About
from tests.command_line import run_rig
from tests.rig.commands.live_runs import live_now, live_status
from tests.rig.news.test_run_news import PROTOCOL, RIG

ABOUT = About("run-1", "/data/run.h5", "A test", "tension", True, ("left",))
ELSEWHERE = "another-computer"


def heartbeat(clock: VirtualClock, **changes: Any) -> dict[str, Any]:
    """Return the heartbeat of a run that pulls, on a computer that cannot be asked for its processes."""
    return {
        **wording.head(ABOUT),
        **wording.status_table(live_status(live_now(0.004))),
        "title": ABOUT.title,
        "run_file": ABOUT.run_file,
        "images": {"left": {"brightness": 0.5, "saturated": 0.0, "sharpness": None}},
        "running_s": 12.3,
        "stale_after_s": 10.0,
        "ended": False,
        "status": None,
        "reason": None,
        "utc": text_of(clock.utc()),
        "pid": os.getpid(),
        "host": ELSEWHERE,
        **changes,
    }


@pytest.fixture
def clock() -> VirtualClock:
    return VirtualClock()


@pytest.fixture
def write(tmp_path, clock):
    """A function that writes the heartbeat of run.h5 and returns the path of run.h5, which is not there."""

    def write(**changes: Any) -> Path:
        (tmp_path / "run.heartbeat.json").write_text(json.dumps(heartbeat(clock, **changes)))
        return tmp_path / "run.h5"

    return write


def watch(path: Path, clock: VirtualClock) -> Watch:
    return Watch(find_source(str(path), clock), clock, lambda line: None)


def test_a_run_that_goes_on_is_told_whole_without_its_run_file(write, clock, tmp_path):
    """The run file is not there, so nothing opens it."""
    watched = watch(write(), clock)
    text = "\n".join(watched.lines())
    assert "SIMULATED: A test, /data/run.h5" in text
    assert "the run goes on, 2 of 4 steps" in text
    assert "the load frame MOVES, at 7000.0 N, 0.4567 mm" in text
    assert "axial 0.4000 ± 0.0020 %, corrected, off_axis" in text
    assert "12.3 s, load 7000.0 N" in text
    assert "left: brightness 50%" in text
    assert (watched.verdict.good, watched.verdict.over) == (True, False)
    assert watched.table()["live"]["recorded"] == 1234
    assert [each.name for each in tmp_path.iterdir()] == ["run.heartbeat.json"]


@pytest.mark.parametrize(("age_s", "good"), [(9.9, True), (10.1, False), (3600.0, False)])
def test_silence_is_told_with_its_age_and_its_meaning(write, clock, age_s, good):
    path = write(utc=text_of(clock.utc() - timedelta(seconds=age_s)))
    watched = watch(path, clock)
    assert watched.verdict.good is good
    if not good:
        assert f"NO NEWS for {age_s:.0f} s" in watched.verdict.sentence
        assert "the run hangs or was killed" in watched.verdict.sentence
        assert "see for yourself that they stand" in watched.verdict.sentence


def test_a_program_that_is_gone_was_killed(write, clock):
    ended = subprocess.run([sys.executable, "-c", "import os; print(os.getpid())"], stdout=subprocess.PIPE)
    watched = watch(write(pid=int(ended.stdout), host=socket.gethostname()), clock)
    assert "it was killed" in watched.verdict.sentence
    assert (watched.verdict.good, watched.verdict.over) == (False, True)
    assert watch(write(host=socket.gethostname()), clock).verdict.good  # this very process


@pytest.mark.parametrize(("status", "good"), [("completed", True), ("aborted", False), ("failed", False)])
def test_how_a_run_ended_is_told_however_long_ago(write, clock, status, good):
    path = write(ended=True, status=status, reason="smoke", stale_after_s=None, utc="2020-01-01T00:00:00Z")
    verdict = watch(path, clock).verdict
    assert verdict.sentence == f"the run has ended, {status}, 2 of 4 steps: smoke"
    assert (verdict.good, verdict.over) == (good, True)


def test_a_pipe_gets_a_line_in_ten_seconds_until_the_run_ends(write, clock):
    path, said = write(), []

    class Beating(FileSource):
        """The heart beats at each reading, and the run ends after a minute."""

        def read(self):
            write(ended=clock.now_s() > 60.0, status="completed" if clock.now_s() > 60.0 else None)
            return super().read()

    watched = Watch(Beating(path.with_suffix(".heartbeat.json"), clock), clock, said.append)
    watched.follow(drawn=False)
    assert clock.now_s() == pytest.approx(60.0, abs=1.5)
    assert len(said) == pytest.approx(60.0 / TOLD_EVERY_S, abs=1.0)
    assert all("axial 0.4000 ± 0.0020 %" in line for line in said)
    assert watched.verdict.over


def test_a_run_that_falls_silent_is_told_at_once_and_again_when_it_comes_back(write, clock):
    path, said = write(), []

    class Silent(FileSource):
        def read(self):
            if not 20.0 < clock.now_s() < 50.0:
                write(ended=clock.now_s() > 70.0, status="completed" if clock.now_s() > 70.0 else None)
            return super().read()

    Watch(Silent(path.with_suffix(".heartbeat.json"), clock), clock, said.append).follow(drawn=False)
    silent = [k for k, line in enumerate(said) if line.startswith("NO NEWS for")]
    assert silent
    assert said[silent[0]].startswith(("NO NEWS for 10 s", "NO NEWS for 11 s"))
    assert 0 < silent[0] <= silent[-1] < len(said) - 1


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("none.h5", None, "got no such file"),
        ("text.h5", b"hello", "expected a run file, got another file"),
        (
            "old.h5",
            b"\x89HDF\r\n\x1a\n" + bytes(100),
            "expected the heartbeat file old.heartbeat.json",
        ),
        ("block.h5", bytes(4096) + b"\x89HDF\r\n\x1a\n", "expected the heartbeat file"),
        ("cut.heartbeat.json", b'{"v": 1, "run"', "expected the news of a run, version 1, got another file"),
        ("list.heartbeat.json", b"[]", "got another file"),
        ("new.heartbeat.json", b'{"v": 9}', "got version 9"),
        ("deep.heartbeat.json", b"[" * 100_000, "got another file"),
        ("empty", "folder", "got one without a heartbeat file"),
    ],
)
def test_what_is_no_run_is_one_sentence(tmp_path, name, content, said):
    path = tmp_path / name
    if content == "folder":
        path.mkdir()
    elif content is not None:
        path.write_bytes(content)
    done = run_rig("watch", path, "--once")
    assert (done.status, done.out) == (2, "")
    assert said in done.err
    assert done.err.count("\n") == 1


def test_the_newest_run_of_a_folder_is_watched(write, clock, tmp_path):
    path = write()
    older = tmp_path / "older.heartbeat.json"
    older.write_text(json.dumps(heartbeat(clock, title="An older test")))
    os.utime(older, (1.0, 1.0))
    assert find_source(str(tmp_path), clock).name == str(path.with_suffix(".heartbeat.json"))


def test_a_finished_run_is_watched_by_the_command(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    large_enough = RIG.replace("width_px = 48", "width_px = 240").replace("height_px = 32", "height_px = 180")
    Path("rig.toml").write_text(large_enough.format(real_time="false"))
    Path("p.toml").write_text(PROTOCOL.format(total_deg=20.0))
    assert run_rig("run", "p.toml", "--rig", "rig.toml", "-o", "run.h5").status == 0
    before = Path("run.h5").stat()
    done = run_rig("watch", "run.h5", "--json", "seen.json")
    assert (done.status, done.err) == (0, "")
    assert "the run has ended, completed, 4 of 4 steps" in done.out
    assert "front: brightness " in done.out
    assert "of the reference" in done.out
    assert done.report["ended"] == "completed"
    after = Path("run.h5").stat()
    assert (after.st_mtime_ns, after.st_atime_ns) == (before.st_mtime_ns, before.st_atime_ns)


@pytest.fixture
def served(write) -> Iterator[tuple[str, dict[str, Any]]]:
    """The address of the HTTP interface of a run, and its status, which the test changes."""
    pytest.importorskip("starlette", reason="the extra http is not installed")
    from rig.news.http_api import RunControl, RunView
    from rig.news.http_server import HttpPlace, HttpServer

    place, bulletin = HttpPlace(0), Bulletin(ABOUT)
    status = {**heartbeat(VirtualClock()), "age_s": 0.2, "outcome": None}
    for key in ("ended", "status", "reason", "utc"):
        del status[key]
    control = RunControl(*[lambda *_: ""] * 6)
    server = HttpServer(
        place, RunView(ABOUT, bulletin, lambda: status, lambda *_: None, control, place.token, place.port)
    )
    server.start()
    yield f"http://127.0.0.1:{place.port}", status
    bulletin.close()
    server.stop()


def test_a_run_is_watched_by_http(served, clock):
    url, status = served
    watched = Watch(HttpSource(f"{url}/v1/", clock), clock, lambda line: None)
    assert watched.verdict.sentence == "the run goes on, 2 of 4 steps"
    assert any("axial 0.4000" in line for line in watched.lines())
    status["age_s"] = 34.0
    assert "NO NEWS for 34 s" in Watch(HttpSource(url, clock), clock, lambda line: None).verdict.sentence
    status["outcome"] = {"status": "aborted", "reason": "smoke"}
    verdict = Watch(HttpSource(url, clock), clock, lambda line: None).verdict
    assert verdict.sentence == "the run has ended, aborted, 2 of 4 steps: smoke"


def test_an_interface_that_has_closed_is_told_and_the_heartbeat_says_how_the_run_ended(served, write, clock):
    url, status = served
    path = write(ended=True, status="completed")
    for run_file, said in (("/nowhere/run.h5", "does not answer any more"), (str(path), "ended, completed")):
        status["run_file"] = run_file
        source = HttpSource(url, clock)
        source.read()
        source._url = "http://127.0.0.1:1/v1/status"
        assert said in Watch(source, clock, lambda line: None).verdict.sentence


@pytest.mark.parametrize("target", ["http://127.0.0.1:1", "https://127.0.0.1:1", "http://"])
def test_an_address_without_a_run_is_one_sentence(target):
    done = run_rig("watch", target)
    assert (done.status, done.err.count("\n")) == (2, 1)


def test_ctrl_c_leaves_the_run_alone(write, monkeypatch):
    path = write(utc="2999-01-01T00:00:00Z")
    monkeypatch.setattr(Watch, "follow", lambda self, *, drawn: (_ for _ in ()).throw(KeyboardInterrupt))
    done = run_rig("watch", path)
    assert (done.status, done.out) == (0, "left; the run is not touched\n")
