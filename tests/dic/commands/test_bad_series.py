"""If some images of a series cannot be measured, one sentence gives the reason, and no result is lost."""

import os
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

from dic.pipeline.result_file import load_series_result
from dic.results.writer import ResultWriter
from tests.command_line import refusal, run_dic
from tests.dic.result_values import bits
from tests.full_disk import full_disk
from tests.image_files import write_image
from tests.run_files import HEADER, write_run

SETTINGS = ("--subset", 21, "--step", 20)
SHIFT_PX = 0.37


@pytest.fixture
def pattern(speckle):
    return speckle(seed=21, shape=(160, 160))


def write_series(pattern, folder, numbers, ending="png"):
    """Write an image for each number, moved to the right by the number times `SHIFT_PX`."""
    folder.mkdir()
    for number in numbers:
        moved = pattern.draw(lambda x, y, by=SHIFT_PX * number: (x - by, y))
        write_image(folder / f"img{number:02d}.{ending}", moved)
    return folder


def shifts_px(path):
    """Return the mean displacement to the right of each image in a result file, by the name of the image."""
    with h5py.File(path) as file:
        series = file["series"]
        names = [Path(label).name for label in series["label"].asstr()]
        return dict(zip(names, np.nanmean(series["u_px"], axis=(1, 2)), strict=True))


def expected_px(*numbers, ending="png"):
    names = [f"img{number:02d}.{ending}" for number in numbers]
    shifts = [SHIFT_PX * number for number in numbers]
    return pytest.approx(dict(zip(names, shifts, strict=True)), abs=0.01)


def test_image_of_another_size_is_left_out(pattern, tmp_path):
    images = write_series(pattern, tmp_path / "images", range(4))
    write_image(images / "img02.png", pattern.draw()[:120])
    done = run_dic("correlate", images, *SETTINGS, "-o", tmp_path / "r.h5")
    (said,) = done.err.splitlines()
    assert said == (
        f"error: {images}/img02.png: deformed image: compare with the reference: expected 160 x 160 px, got"
        " 160 x 120 px; use images that one camera took with one readout region, all 160 x 160 px"
    )
    assert done.status == 2
    assert shifts_px(tmp_path / "r.h5") == expected_px(1, 3)


@pytest.mark.filterwarnings("always::dic.errors.ImageWarning")
@pytest.mark.parametrize("source", ["images", "images/*.png"])
def test_missing_numbers_are_named_and_the_other_images_are_measured(pattern, source, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_series(pattern, tmp_path / "images", (0, 1, 2, 3, 5, 8, 9))
    done = run_dic("correlate", source, *SETTINGS, "-o", "r.h5")
    (said,) = done.err.splitlines()
    missing = "img04.png, img06.png to img07.png"
    assert said == f"warning: {source}: {missing} missing; the other images are used"
    assert done.status == 0
    assert shifts_px(tmp_path / "r.h5") == expected_px(1, 2, 3, 5, 8, 9)


def test_truncated_last_image_is_left_out(pattern, tmp_path):
    images = write_series(pattern, tmp_path / "images", range(3), "tif")
    last = images / "img02.tif"
    last.write_bytes(last.read_bytes()[:9000])
    done = run_dic("correlate", images, *SETTINGS, "-o", tmp_path / "r.h5")
    (said,) = done.err.splitlines()
    assert f"{last}: read image: expected a whole" in said
    assert "got a file that was cut off after 9000 bytes; save or copy it again" in said
    assert done.status == 2
    assert shifts_px(tmp_path / "r.h5") == expected_px(1, ending="tif")


@pytest.mark.parametrize("share", [0.02, 0.6])
def test_full_disk_ends_in_one_sentence_and_loses_no_finished_image(
    pattern, share, tmp_path, correlated, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    write_series(pattern, tmp_path / "images", range(4))
    result = tmp_path / "r.h5"
    words = ("correlate", "images", "--subset", 21, "--step", 2, "-o", "r.h5")
    assert run_dic(*words).status == 0
    whole = bits(result)
    size = int(share * result.stat().st_size)
    result.unlink()
    correlated.clear()
    with monkeypatch.context() as patched, full_disk(size):
        patched.setattr(ResultWriter, "_is_due", lambda writer: True)
        said = refusal(*words)
    assert "expected a disk with room for them, got File too large; make room, and give the same" in said
    assert result.exists() == (share > 0.1)
    finished = len(load_series_result(result).images) if result.exists() else 0
    assert (finished > 0) == (share > 0.1)
    correlated.clear()
    assert run_dic(*words).status == 0
    assert len(correlated) == 3 - finished
    assert bits(result) == whole
    assert list(tmp_path.glob(".*")) == []


def test_table_on_a_full_disk_is_named(pattern, tmp_path):
    images = write_series(pattern, tmp_path / "images", range(2))
    with full_disk(1000):
        said = refusal("correlate", images, *SETTINGS, "--csv", tmp_path / "csv")
    assert said == f"error: {tmp_path}/csv/img01.csv: File too large; name a place that can be used"


def test_result_of_another_version_says_who_wrote_it_and_stays(pattern, tmp_path):
    images = write_series(pattern, tmp_path / "images", range(2))
    result = tmp_path / "r.h5"
    words = ("correlate", images, *SETTINGS, "-o", result)
    assert run_dic(*words).status == 0
    with h5py.File(result, "r+") as file:
        file.attrs["file_format_version"] = 2
        file["provenance"].attrs["versions"] = "offaxis 0.7.3, numpy 3.0.0"
    before = result.read_bytes()
    for command in (
        ("strain", result, "-o", tmp_path / "s.h5"),
        ("report", result, "-o", tmp_path / "r.html"),
        ("settings", result),
        (*words[:-1], tmp_path / "n.h5", "--fields-from", result),
    ):
        said = refusal(*command)
        assert f"{result}: read results: expected format 1 of result files, which offaxis " in said
        assert "got format 2, written by offaxis 0.7.3; read it with offaxis 0.7.3 or a newer one" in said
    assert "one that exists" in refusal(*words)
    assert result.read_bytes() == before


def test_run_file_of_another_version_says_who_wrote_it(tmp_path):
    path = write_run(tmp_path / "run.h5", header=replace(HEADER, versions="python 3.19.0\noffaxis 0.7.3"))
    path.chmod(0o644)
    with h5py.File(path, "r+") as file:
        file.attrs["file_format_version"] = 2
    for command in (("process", path, "-o", tmp_path / "r.h5"), ("draw", path, "-o", tmp_path / "d.html")):
        said = refusal(*command)
        assert f"{path}: read run: expected format 1 of run files, which offaxis " in said
        assert "got format 2, written by offaxis 0.7.3; read it with offaxis 0.7.3 or a newer one" in said
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("command", ["strain", "report", "export", "settings", "gauges"])
def test_what_is_no_result_file_is_said_in_the_same_words_by_every_command(command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_run(tmp_path / "run.h5")
    (tmp_path / "cut.h5").write_bytes((tmp_path / "run.h5").read_bytes()[:3000])
    (tmp_path / "g.toml").write_text('[[gauge]]\nname = "p"\nkind = "point"\nat = [9, 9]\nwidth = 3\n')
    more = {"settings": (), "export": ("csv", "-o", "out"), "gauges": ("g.toml", "-o", "out")}
    for name, got in (
        ("run.h5", "a run file; measure it with `dic process run.h5`"),
        ("cut.h5", "a file that was cut off or is no HDF5; name another file"),
        ("absent.h5", "no such file; name another file"),
    ):
        assert refusal(command, name, *more.get(command, ("-o", "out"))) == (
            f"error: {name}: read results: expected a result file of `dic correlate -o` or `dic process`,"
            f" got {got}"
        )


WAITING = """
import os, signal, sys
from dic.cli import main
from dic.results.writer import ResultWriter

def commit(self, committed=ResultWriter.commit, **how):
    committed(self)
    print("measuring", flush=True)
    signal.pause()

ResultWriter.commit = commit
sys.argv = {argv!r}
main()
"""


@pytest.mark.extended
def test_second_program_on_a_result_is_refused_and_the_first_loses_nothing(pattern, tmp_path, correlated):
    images = write_series(pattern, tmp_path / "images", range(4))
    result, whole = tmp_path / "r.h5", tmp_path / "whole.h5"
    words = ("correlate", images, *SETTINGS, "-o", result)
    assert run_dic(*words[:-1], whole).status == 0
    correlated.clear()
    script = WAITING.format(argv=["dic", *map(str, words)])
    with subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, text=True) as first:
        try:
            assert first.stdout is not None
            while first.stdout.readline() != "measuring\n":
                assert first.poll() is None
            for forced in ((), ("--force",)):
                said = refusal(*words, *forced)
                assert f"{result}: write results: expected a result file of its own" in said
                assert "got one that another program is measuring into; wait until that program" in said
            # Strain from the fields of another file would be overwritten, or would overwrite.
            for others in (("strain", whole), (*words[:-2], "--fields-from", whole, "--strain-window", 7)):
                said = refusal(*others, "-o", result, "--force")
                assert "got one that another program is measuring into" in said
        finally:
            os.kill(first.pid, signal.SIGKILL)
    assert correlated == []
    assert run_dic(*words).status == 0
    assert len(correlated) == 2
    assert shifts_px(result) == expected_px(1, 2, 3)
