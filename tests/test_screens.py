"""Test the output of every command on a terminal, in a pipe, and with a closed output.

The screens on a terminal of 80 columns are kept in `tests/screens_as_text`. After a change of what a command
prints, write them again with `python -m tests.test_screens`, and look at them.
"""

import io
import os
import re
import shutil
import subprocess
import sys
import tempfile
from contextlib import chdir
from functools import cache
from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.command_line import run_both
from tests.conftest import SpecklePattern
from tests.fuzz.good_files import CURVE
from tests.image_files import write_image
from tests.places import EXAMPLES, ROOT, example
from tests.screens import terminal

KEPT = ROOT / "tests" / "screens_as_text"
CAMERA = 'driver = "simulated-camera"'
BAR = re.compile(r"\w+ +[━╸╺ ]+(\d+/\S+)? ?([-\d:]+)?")
"""A progress bar, possibly cut off at its end."""

COMMANDS = {
    "quality": "dic quality reference.png",
    "quality-of-a-series": "dic quality img*.png --subset 21",
    "quality-of-a-bad-image": "dic quality flat.png",
    "study": "dic study middle.png --subsets 21,31 --steps 10 --windows 3,5",
    "example": "dic example small --force",
    "calibrate": "dic calibrate grid.png -o cal.h5 --force",
    "correlate": "dic correlate ref.png img1.png img2.png img10.png other.png none.png --subset 21",
    "correlate-calibrated": "dic correlate reference.png loaded.png --calibration cal.h5 --step 40",
    "compare": "dic compare results.h5 exports/dice/DICe_solution_1.txt --image 1",
    "export": "dic export results.h5 csv vtk netcdf -o exports --force",
    "gauges": "dic gauges results.h5 gauges.toml",
    "properties": "dic properties curve.csv --load Load:kN --strain Strain:% --area-mm2 20",
    "campaign": "dic campaign specimens",
    "refusal": "dic correlate ref.png img1.png --subset 20",
    "usage": "dic correlate ref.png img1.png --subsets 21",
    "plan": "rig plan rotation.toml --rig rig.toml",
    "check": "rig check rig.toml",
    "focus": "rig focus rig.toml --once",
    "run": "rig run rotation.toml --rig rig.toml -o run.h5",
    "watch": "rig watch run.h5",
    "verify": "rig verify run.h5",
    "repair": "rig repair run.h5",
    "replay": "rig replay run.h5",
    "status": "rig status rig.toml",
    "hold": "rig hold rig.toml",
    "jog": "rig jog tension-rig.toml --load-n 500 --yes",
    "devices": "rig devices --no-probe",
    "faults": "rig simulate --list-faults",
    "refused-run": "rig run none.toml --rig rig.toml",
}
DRAWING = ("correlate", "quality-of-a-series", "run", "jog")
"""Commands that draw on the terminal. The lines of all other commands are broken by the terminal only."""
SLOW = ("study", "campaign", "quality-of-a-series")
"""Commands that print what others of them print, and compute for longer."""
UNREAD = ("quality", "correlate", "refusal", "plan", "run", "verify")
"""Commands of both programs that print a table, draw, or refuse; nobody reads them in the first part."""

GAUGES = """
[[gauge]]
name = "axial"
kind = "extensometer"
start = [40, 80]
end = [140, 80]
patch = 30
[[gauge]]
name = "across"
kind = "transverse"
start = [90, 40]
end = [90, 120]
patch = 20
spread = 80
[[gauge]]
name = "middle"
kind = "cut"
start = [40, 40]
end = [140, 120]
"""

SPECIMENS = {"s1": 19.8, "s2": 20.0, "s3": 20.3, "s4": 20.1}
CAMPAIGN = """
[defaults]
load = "Load:kN"
strain = "Strain:%"
area_mm2 = 20.0
load_std_percent = 0.3
""" + "".join(f'[[specimen]]\nfile = "{name}.csv"\n' for name in (*SPECIMENS, "lost"))

VARYING = {"devices", "usage", "watch"}
"""Commands whose screen depends on the machine, the folder, or the name of the program."""


def make_files(folder: Path) -> None:
    """Make the files that the commands read: images, a calibration, a rig and a finished run."""
    pattern = SpecklePattern(seed=21)
    write_image(folder / "ref.png", pattern.draw())
    for name, stretch in (("img1", 0.001), ("img2", 0.002), ("img10", 0.01)):
        write_image(folder / f"{name}.png", pattern.draw(lambda x, y, s=stretch: (x / (1 + s), y)))
    write_image(folder / "other.png", SpecklePattern(seed=5).draw())
    write_image(folder / "flat.png", np.full((160, 180), 77))
    for name in ("grid", "reference", "loaded"):
        shutil.copy(EXAMPLES / "images" / f"{name}.png", folder)
    reference = cv2.imread(str(folder / "reference.png"), cv2.IMREAD_GRAYSCALE)
    write_image(folder / "middle.png", reference[96:416, 96:416])
    turns = (("increment_deg = 22.5", "increment_deg = 180.0"),)
    (folder / "rotation.toml").write_text(example("rotation", *turns))
    small = (CAMERA, f"{CAMERA}\nwidth_px = 32\nheight_px = 24")
    (folder / "rig.toml").write_text(example("rig-virtual-rotation-30", small))
    (folder / "tension-rig.toml").write_text(example("rig-virtual-tension", small))
    (folder / "gauges.toml").write_text(GAUGES)
    (folder / "curve.csv").write_text(CURVE)
    (folder / "specimens").mkdir()
    (folder / "specimens" / "campaign.toml").write_text(CAMPAIGN)
    for name, area_mm2 in SPECIMENS.items():
        # the same curve with the load of another area
        lines = CURVE.splitlines()[2:]
        rows = [line.split(";") for line in lines]
        text = [f"{time};{float(load) * area_mm2 / 20:.5f};{strain}" for time, load, strain in rows]
        (folder / "specimens" / f"{name}.csv").write_text("\n".join([*CURVE.splitlines()[:2], *text]))
    series = "dic correlate ref.png img1.png img2.png --subset 21 -o results.h5"
    assert run_both(*series.split(), out=io.StringIO(), err=io.StringIO()) == 0
    peer = "dic export results.h5 dice -o exports"
    assert run_both(*peer.split(), out=io.StringIO(), err=io.StringIO()) == 0
    for name in ("calibrate", "run"):
        assert piped(name)[0] == 0


def typed(name: str) -> list[str]:
    """Return the words of a command; delete the earlier run file, which `rig run` would not replace."""
    if name == "run":
        Path("run.h5").unlink(missing_ok=True)
    return COMMANDS[name].split()


@cache
def piped(name: str) -> tuple[int, str, str]:
    """Return the exit status of a command, and its output and error text without a terminal."""
    out, err = io.StringIO(), io.StringIO()
    status = run_both(*typed(name), out=out, err=err)
    return status, out.getvalue(), err.getvalue()


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    made = tmp_path_factory.mktemp("screens")
    with chdir(made):
        make_files(made)
    return made


@pytest.fixture(autouse=True)
def _in_folder(folder, monkeypatch):
    monkeypatch.chdir(folder)
    monkeypatch.setenv("TERM", "xterm")


def on_terminal(name: str, columns: int) -> tuple[int, list[str], list[str]]:
    """Return the exit status of a command on a terminal, the lines of its last screen, and every screen."""
    with terminal(columns) as (stream, watched):
        status = run_both(*typed(name), out=stream, err=stream)
    return status, watched.lines, watched.seen


def masked(text: str) -> str:
    """Replace numbers by #, because their last digits depend on the processor, and join spaces."""
    return re.sub(r"\s+", " ", re.sub(r"-?\d[\d.:e+-]*", "#", text))


@pytest.mark.parametrize(
    ("name", "columns"),
    [
        *(pytest.param(name, 80, marks=pytest.mark.extended if name in SLOW else ()) for name in COMMANDS),
        *(pytest.param(name, 120, marks=pytest.mark.extended) for name in DRAWING),
    ],
)
def test_terminal_shows_each_line_of_a_pipe_and_no_line_stands_behind_a_bar(name, columns):
    """The screen of 80 columns is the one that was looked at."""
    expected, out, err = piped(name)
    status, lines, seen = on_terminal(name, columns)
    assert status == expected
    printed = (out + err).splitlines()
    broken = [part for line in printed for part in re.findall(f".{{1,{columns}}}", line.rstrip())]
    assert sorted(map(masked, filter(None, lines))) == sorted(masked(part.rstrip()) for part in broken)
    drawn = [line for screen in seen for line in screen.splitlines() if set("━╸╺") & set(line)]
    assert [line for line in drawn if not BAR.fullmatch(line) and "Ctrl-C" not in line] == []
    assert not set("━╸╺") & set("".join(lines))
    if columns == 80 and name not in VARYING:
        kept = (KEPT / f"{name}.txt").read_text(encoding="utf-8")
        assert masked("\n".join(lines)) == masked(kept.strip())


def test_tables_of_a_series_fit_100_columns():
    for name in ("correlate", "correlate-calibrated"):
        _, out, _ = piped(name)
        rows = [line for line in out.splitlines() if " ± " in line and "contains" not in line]
        assert rows
        assert max(map(len, rows)) <= 100


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[] if name in UNREAD else pytest.mark.extended) for name in COMMANDS]
)
def test_output_that_nobody_reads_changes_neither_the_status_nor_the_complaints(name):
    status, _, complaints = piped(name)
    reader, writer = os.pipe()
    os.close(reader)
    with os.fdopen(writer, "w") as nobody:
        err = io.StringIO()
        assert run_both(*typed(name), out=nobody, err=err) == status
        assert masked(err.getvalue()) == masked(complaints)


@pytest.mark.parametrize(
    ("script", "status"),
    [
        ("{dic} quality reference.png | head -1; exit ${{PIPESTATUS[0]}}", 0),
        pytest.param("{dic} quality reference.png >&-", 0, marks=pytest.mark.extended),
        pytest.param("{dic} quality flat.png >&- 2>&-", 2, marks=pytest.mark.extended),
        pytest.param(
            "{rig} plan rotation.toml | head -1; exit ${{PIPESTATUS[0]}}", 0, marks=pytest.mark.extended
        ),
        ("{rig} plan none.toml 2>&1 | true; exit ${{PIPESTATUS[0]}}", 2),
    ],
)
def test_program_in_a_shell_ends_with_its_status_and_no_traceback(script, status):
    programs = {name: f"{sys.executable} -c 'from {name}.cli import main; main()'" for name in ("dic", "rig")}
    done = subprocess.run(["bash", "-c", script.format(**programs)], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (status, "")
    assert len(done.stdout.splitlines()) <= 1


def write_screens() -> None:
    """Write the screens of all commands to `tests/screens_as_text`; look at them afterwards."""
    os.environ["TERM"] = "xterm"
    KEPT.mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory() as place, chdir(place):
        make_files(Path(place))
        for name in sorted(COMMANDS.keys() - VARYING):
            _, lines, _ = on_terminal(name, 80)
            (KEPT / f"{name}.txt").write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    write_screens()
