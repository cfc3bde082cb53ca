"""`dic` works without functions that only Linux has; the tests remove these functions from programs.

Windows has no `os.fork`, no `resource` limits, no `fcntl` and few signals, and can wait for sockets only.
"""

import csv
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from rig.run import run_protocol
from tests.places import ROOT, example, small_cameras

TAKEN_AWAY = """
import os, select, signal, socket, sys

for name in (
    "fork", "forkpty", "killpg", "setsid", "getpgid", "sched_getaffinity", "getuid", "geteuid", "pread",
    "pwrite", "mkfifo", "statvfs", "posix_fallocate", "O_NONBLOCK", "O_CLOEXEC", "O_DIRECTORY",
):
    if hasattr(os, name):
        delattr(os, name)
# Python's own modules use these with the functions above, and a system without those has not these either.
os.supports_dir_fd.clear()
os.supports_fd.clear()
os.process_cpu_count = os.cpu_count
for name in dir(signal):
    kept = ("SIGINT", "SIGTERM", "SIGABRT", "SIGFPE", "SIGILL", "SIGSEGV", "SIG_DFL", "SIG_IGN")
    # the module subprocess of this system, which is not that of Windows, needs SIGKILL
    if name.startswith("SIG") and name not in (*kept, "SIGKILL"):
        delattr(signal, name)
for name in ("fcntl", "resource", "termios", "tty", "pty", "pwd", "grp"):
    sys.modules[name] = None
_select = select.select


def of_sockets(*lists):
    if not all(isinstance(each, socket.socket) for ready in lists[:3] for each in ready):
        raise OSError(10038, "An operation was attempted on something that is not a socket")
    return _select(*lists)


select.select = of_sockets
"""


@pytest.fixture(scope="module")
def bare(tmp_path_factory):
    """A function that runs `dic`, and the programs started by it, without the functions of Linux."""
    folder = tmp_path_factory.mktemp("elsewhere")
    (folder / "sitecustomize.py").write_text(TAKEN_AWAY)
    environment = os.environ | {
        "PYTHONPATH": os.pathsep.join([str(folder), str(ROOT)]),
        # the encoding of pipes on a Windows of western Europe, which knows µ and ±, but no ε
        "PYTHONIOENCODING": "cp1252:strict",
    }

    def run(
        *words: object, cwd: Path, code: str = "from dic.cli import main; main()"
    ) -> subprocess.CompletedProcess[str]:
        command = [sys.executable, "-c", code, *map(str, words)]
        return subprocess.run(
            command, cwd=cwd, env=environment, capture_output=True, text=True, encoding="cp1252", timeout=110,
            check=False,
        )  # fmt: skip

    return run


def assert_good(done: subprocess.CompletedProcess[str]) -> None:
    assert done.returncode == 0, done.stderr
    assert "Traceback" not in done.stderr


def test_what_is_taken_away_is_missed(bare, tmp_path):
    """The tests below try nothing if the programs still find it."""
    for needed in ("from os import fork", "import fcntl", "import resource", "from signal import SIGHUP"):
        done = bare(cwd=tmp_path, code=needed)
        assert "Error" in done.stderr, needed
    assert "not a socket" in bare(cwd=tmp_path, code="import select; select.select([0], [], [], 0)").stderr


@pytest.mark.extended
def test_images_are_measured_to_tables_maps_and_result_files(bare, tmp_path):
    assert_good(bare("example", "first", cwd=tmp_path))
    assert_good(bare("quality", "first/reference.png", "--plot", "quality.png", cwd=tmp_path))
    target = ["--lines", "21x21", "--pitch-mm", "0.5", "-o", "cal.h5", "--plot", "grid.png"]
    assert_good(bare("calibrate", "first/grid.png", *target, cwd=tmp_path))
    outputs = ["--csv", "points", "--maps", "maps", "--json", "r.json", "-o", "r.h5"]
    settings = ["--calibration", "cal.h5", "--motion", "tension", "--step", "20"]
    images = ["first/reference.png", "first/step-04.png", "first/step-08.png"]
    done = bare("correlate", *images, *settings, *outputs, cwd=tmp_path)
    assert_good(done)
    found = json.loads((tmp_path / "r.json").read_text(encoding="utf-8"))["images"][1]
    truth = json.loads((tmp_path / "first" / "truth.json").read_text(encoding="utf-8"))["images"][7]
    assert found["corrected"]["eyy"] == pytest.approx(truth["eyy"], abs=60e-6)
    with (tmp_path / "points" / "step-08.csv").open(newline="", encoding="utf-8") as file:
        assert len(list(csv.DictReader(file))) > 100
    assert (tmp_path / "maps" / "step-08.png").is_file()


@pytest.mark.long
def test_a_run_is_processed_to_a_report(bare, tmp_path):
    protocol = tmp_path / "short.toml"
    protocol.write_text(example("rotation", ("total_deg = 360.0", "total_deg = 22.5")))
    rig_path = tmp_path / "rig.toml"
    rig_path.write_text(example("rig-virtual-rotation-30", small_cameras(450, 1400.0)))
    assert run_protocol(protocol, rig_path, tmp_path / "run.h5")
    done = bare("process", "run.h5", "--step", "40", "--report", "report.html", cwd=tmp_path)
    assert_good(done)
    assert (tmp_path / "report.html").stat().st_size > 50_000
    assert_good(bare("report", "run.results.h5", "-o", "again.html", cwd=tmp_path))


def test_a_damaged_file_is_refused_in_one_sentence(bare, tmp_path):
    (tmp_path / "bad.h5").write_bytes(b"\x89HDF\r\n\x1a\n" + bytes(3000))
    done = bare("process", "bad.h5", cwd=tmp_path)
    assert done.returncode == 2
    assert done.stderr.startswith("error: bad.h5: read run: expected")
    assert done.stderr.count("\n") == 1
