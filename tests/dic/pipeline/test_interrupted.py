"""A killed measurement continues with the next image, and its results are identical bit by bit."""

import json
import os
import random
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import dic
from dic.files.lock import lock_file
from dic.pipeline.result_writer import MeasurementWriter
from dic.results.place import alone
from dic.results.writer import ResultWriter
from tests.command_line import refusal, run_dic
from tests.dic.pipeline.rendered_run import SMALL, slid, write_rendered_run
from tests.dic.result_values import bits
from tests.image_files import write_image

pytestmark = pytest.mark.usefixtures("grids_found_once")
KILLED = """
import os, signal, sys
from dic.cli import main
from dic.results.writer import ResultWriter

commits = []

def commit(self, committed=ResultWriter.commit, **how):
    committed(self)
    commits.append(self)
    if len(commits) == {last}:
        os.kill(os.getpid(), signal.SIGKILL)

ResultWriter.commit = commit
sys.argv = {argv!r}
main()
"""


def start_killed(last: int, *words: object) -> None:
    """Run `dic` as a separate program, which is killed after it has finished the image number `last`."""
    script = KILLED.format(last=last, argv=["dic", *map(str, words)])
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, check=False)
    assert done.returncode == -signal.SIGKILL, done


def interrupt(patch: pytest.MonkeyPatch, last: int, *words: object) -> None:
    """Run `dic` in this process; it is interrupted after it has finished the image number `last`.

    What was finished before is the same as after a kill, which takes the time of a program's start.
    """
    add, added = ResultWriter.add_field, []

    def interrupted(self: ResultWriter, *given: object) -> None:
        add(self, *given)
        added.append(given)
        if len(added) == last:
            raise KeyboardInterrupt

    with patch.context() as patched:
        patched.setattr(ResultWriter, "add_field", interrupted)
        done = run_dic(*words)
    assert done.status == 2, done
    assert "error: interrupted before the end" in done.err, done


def left_beside(result: Path) -> list[Path]:
    """Return what a measurement has left beside its result file."""
    return list(result.parent.glob(f".{result.name}*"))


@pytest.fixture(scope="module")
def images(speckle, tmp_path_factory):
    """A folder with a reference and five images of a growing shift; the fourth shows nothing."""
    folder = tmp_path_factory.mktemp("images")
    pattern = speckle(seed=21, shape=(160, 160))
    for number in range(6):
        moved = pattern.draw(lambda x, y, by=0.37 * number: (x - by, y))
        write_image(folder / f"img{number}.png", np.full((160, 160), 128.0) if number == 4 else moved)
    return folder


@pytest.mark.extended
@pytest.mark.parametrize("incremental", ["auto", "always"])
def test_killed_series_goes_on_with_the_same_bits(images, incremental, tmp_path, correlated, monkeypatch):
    monkeypatch.chdir(tmp_path)
    words = (
        "correlate", images, "--subset", 21, "--step", 20, "--incremental", incremental, "-o", "r.h5",
        "--csv", "csv", "--json", "r.json",
    )  # fmt: skip
    assert run_dic(*words).status == 2
    assert len(correlated) == 5
    results = [tmp_path / name for name in ("r.h5", "r.json", "csv/strain.csv", "csv/img5.csv")]
    whole = [path.read_bytes() for path in results]
    for path in tmp_path.rglob("*.*"):
        if path.is_file():
            path.unlink()
    start_killed(3, *words)
    assert [image.label for image in dic.load_series_result("r.h5").images] == [
        f"{images}/img{k}.png" for k in (1, 2, 3)
    ]
    assert (tmp_path / "csv" / "img2.csv").exists()
    correlated.clear()
    # Nothing has to be forced, although tables of the killed program are there.
    assert run_dic(*words).status == 2
    assert len(correlated) == 2
    assert [path.read_bytes() for path in results] == whole
    assert left_beside(tmp_path / "r.h5") == []
    assert "one that exists" in refusal(*words)


def test_series_with_another_image_correlates_from_there_on(images, tmp_path, correlated, monkeypatch):
    result = tmp_path / "r.h5"
    words = ("correlate", *sorted(images.glob("img[0-3].png")), "--subset", 21, "--step", 20, "-o", result)
    interrupt(monkeypatch, 2, *words)
    correlated.clear()
    changed = tmp_path / "img2.png"
    changed.write_bytes((images / "img3.png").read_bytes())
    other = [changed if word == images / "img2.png" else word for word in words]
    assert run_dic(*other).status == 0
    assert len(correlated) == 2


def test_other_settings_leave_what_was_finished(images, tmp_path, correlated, monkeypatch):
    result = tmp_path / "r.h5"
    words = ("correlate", *sorted(images.glob("img[0-2].png")), "--subset", 21, "--step", 20, "-o", result)
    interrupt(monkeypatch, 1, *words)
    correlated.clear()
    assert "one that exists" in refusal(*words, "--min-zncc", 0.7)
    # The same command goes on with --force, too.
    for name, forced in (("one.h5", ()), ("other.h5", ("--force",))):
        shutil.copy2(result, tmp_path / name)
        correlated.clear()
        assert run_dic(*words[:-1], tmp_path / name, *forced).status == 0
        assert len(correlated) == 1
        assert left_beside(tmp_path / name) == []


def test_two_programs_on_one_result_are_refused_in_one_sentence(images, tmp_path):
    result = tmp_path / "r.h5"
    with alone(result):
        said = refusal("correlate", images, "--subset", 21, "-o", result)
    assert "got one that another program is measuring into; wait" in said
    assert left_beside(result) == []


def test_what_killed_programs_left_unpublished_is_removed(tmp_path):
    result = tmp_path / "r[1].h5"
    killed, writing = (tmp_path / f".r[1].h5.{number}.partial" for number in (11, 12))
    killed.write_bytes(b"no results yet")
    lock = lock_file(writing)
    with alone(result):
        assert not killed.exists()
        assert writing.exists()
    os.close(lock)


@pytest.fixture(scope="module")
def run_file(tmp_path_factory):
    loads = [slid(0.05 * number) for number in range(1, 4)]
    return write_rendered_run(tmp_path_factory.mktemp("run") / "run.h5", loads, camera=SMALL)


def test_interrupted_run_goes_on_with_the_same_bits(run_file, tmp_path, correlated, monkeypatch):
    monkeypatch.chdir(tmp_path)
    words = ("process", run_file, "--step", 40, "-o", "r.h5")
    assert run_dic(*words).status == 0
    assert len(correlated) == 3
    result = tmp_path / "r.h5"
    whole = bits(result)
    result.unlink()
    interrupt(monkeypatch, 2, *words)
    correlated.clear()
    add = MeasurementWriter.add_step

    def full(self: MeasurementWriter, *given: object) -> None:
        raise OSError(28, "No space left on device")

    # The disk is full while the strains are written.
    monkeypatch.setattr(MeasurementWriter, "add_step", full)
    assert "No space left on device" in refusal(*words)
    assert "interrupted before its strains were computed" in refusal("report", result, "-o", "r.html")
    monkeypatch.setattr(MeasurementWriter, "add_step", add)
    assert run_dic(*words).status == 0
    assert len(correlated) == 1
    assert bits(result) == whole
    assert left_beside(result) == []


WATCHED = """
import json, sys
from pathlib import Path
from dic.cli import main
from dic.results.writer import ResultWriter

resident = {{"correlated": [], "written": []}}

def watched(kind, work):
    def watch(*given, **named):
        done = work(*given, **named)
        status = Path("/proc/self/status").read_text()
        resident[kind].append(int(status.split("VmRSS:")[1].split()[0]))
        return done
    return watch

ResultWriter.add_field = watched("correlated", ResultWriter.add_field)
ResultWriter.add = watched("written", ResultWriter.add)
sys.argv = {argv!r}
try:
    main()
finally:
    Path({record!r}).write_text(json.dumps(resident))
"""


def resident_kb(folder: Path, *words: object) -> dict[str, list[int]]:
    """Run `dic` as a separate program; return its resident memory, kB, after each image and table row."""
    record = folder / "resident.json"
    argv = ["dic", *map(str, words)]
    script = WATCHED.format(argv=argv, record=str(record))
    subprocess.run([sys.executable, "-c", script], capture_output=True, check=True)
    found: dict[str, list[int]] = json.loads(record.read_text())
    return found


def many_images(speckle, folder: Path, count: int) -> None:
    """Write a reference and `count` images of a moving pattern to a folder."""
    pattern = speckle(seed=21, shape=(160, 160))
    moved = [pattern.draw(lambda x, y, by=0.37 * number: (x - by, y)) for number in range(10)]
    for number in range(count + 1):
        write_image(folder / f"img{number:05d}.png", moved[number % 10])


@pytest.mark.long
@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="needs /proc for the resident memory")
@pytest.mark.parametrize("kind", ["correlate", "process"])
def test_resident_memory_is_the_same_after_100_and_after_1000_images(kind, speckle, tmp_path):
    if kind == "correlate":
        many_images(speckle, tmp_path, 1000)
        words = (kind, tmp_path, "--subset", 21, "--step", 3)
    else:
        loads = [slid(0.05 * number) for number in range(1, 5)]
        words = (kind, write_rendered_run(tmp_path / "run.h5", loads, repeats=250), "--step", 8)
    resident = resident_kb(tmp_path, *words, "-o", tmp_path / "results.h5")
    assert [len(values) for values in resident.values()] == [1000, 1000]
    for values in resident.values():
        assert np.mean(values[980:]) == pytest.approx(np.mean(values[80:120]), rel=0.05)


@pytest.mark.long
@pytest.mark.parametrize("kind", ["correlate", "process"])
def test_twenty_kills_at_random_moments_change_no_bit(kind, images, run_file, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    given = (images, "--subset", 21, "--step", 3) if kind == "correlate" else (run_file, "--step", 8)
    words = (kind, *given, "-o", "r.h5")
    command = [sys.executable, "-c", "from dic.cli import main; main()", *map(str, words)]
    started = time.perf_counter()
    monkeypatch.setattr(sys, "argv", ["dic", *map(str, words)])
    subprocess.run(command, capture_output=True, check=False)
    took_s, result = time.perf_counter() - started, tmp_path / "r.h5"
    whole, rng = bits(result), random.Random(5)
    result.unlink()
    kills = 0
    while kills < 20:
        program = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        try:
            program.wait(rng.uniform(0.3, 1.0) * took_s)
        except subprocess.TimeoutExpired:
            os.kill(program.pid, signal.SIGKILL)
            program.wait()
            kills += 1
            continue
        assert bits(result) == whole
        result.unlink()
    subprocess.run(command, capture_output=True, check=False)
    assert bits(result) == whole
    assert left_beside(result) == []
