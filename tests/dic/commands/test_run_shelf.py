"""`dic process` with several runs: one result each, and no run stops the others."""

import shutil
from pathlib import Path

import pytest

from dic.commands import run_work
from dic.pipeline.run_source import list_run_files
from tests.command_line import refusal, run_dic
from tests.dic.pipeline.rendered_run import SMALL, slid, write_rendered_run
from tests.dic.result_values import results
from tests.run_files import write_continued_run

pytestmark = pytest.mark.usefixtures("grids_found_once")
WORDS = ("--step", 40, "--subset", 31)


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    return write_rendered_run(tmp_path_factory.mktemp("run") / "run.h5", [slid(0.05)], camera=SMALL)


@pytest.fixture
def shelf(run, tmp_path, monkeypatch):
    """A folder with two good runs and, between them in natural order, one that was cut off."""
    monkeypatch.chdir(tmp_path)
    folder = tmp_path / "runs"
    folder.mkdir()
    for name in ("run2.h5", "run10.h5"):
        shutil.copy(run, folder / name)
    (folder / "run3.h5").write_bytes(run.read_bytes()[:5000])
    (folder / "notes.txt").write_text("no run")
    return folder


def closing(done):
    """Return the closing table: its heading, and the words of each run, by the name of its file."""
    lines = done.out.splitlines()
    (at,) = [k for k, line in enumerate(lines) if " runs: " in line or " run: " in line]
    return lines[at], {line.split()[-1]: line.split()[:-1] for line in lines[at + 1 :]}


def test_every_run_gets_its_result_and_finished_runs_are_not_correlated_again(shelf, correlated):
    done = run_dic("process", "runs", *WORDS)
    assert done.status == 2
    (said,) = done.err.splitlines()
    assert said.startswith("error: runs/run3.h5: read run: expected a run file")
    heading, table = closing(done)
    assert heading == "3 runs: 2 measured, 1 not processed"
    assert table == {
        "runs/run2.h5": ["measured", "1", "images"],
        "runs/run3.h5": ["not", "processed"],
        "runs/run10.h5": ["measured", "1", "images"],
    }
    assert list(table) == ["runs/run2.h5", "runs/run3.h5", "runs/run10.h5"]
    first, second = (shelf / f"{name}.results.h5" for name in ("run2", "run10"))
    assert results(first).keys() == results(second).keys()
    assert len(correlated) == 2
    second.unlink()
    again = run_dic("process", "runs", "runs/run2.h5", *WORDS)
    assert len(correlated) == 3
    assert closing(again)[0] == "3 runs: 1 known before, 1 not processed, 1 measured"


@pytest.mark.extended
def test_new_strains_of_a_shelf_are_printed_and_called_new(shelf, correlated):
    (shelf / "run3.h5").unlink()
    (shelf / "run10.h5").unlink()
    first = run_dic("process", "runs", *WORDS)
    assert closing(first)[0] == "1 run: 1 measured"
    heading_of_strains = first.out.splitlines()[1]
    assert heading_of_strains.startswith("Rotation at 30°")
    known = run_dic("process", "runs", *WORDS)
    assert closing(known)[0] == "1 run: 1 known before"
    anew = run_dic("process", "runs", *WORDS, "--strain-window", 9, "--force")
    assert closing(anew)[0] == "1 run: 1 strain anew"
    assert closing(anew)[1]["runs/run2.h5"] == ["strain", "anew", "1", "images"]
    assert len(correlated) == 1
    assert heading_of_strains in anew.out
    assert heading_of_strains not in known.out


def test_a_run_that_another_run_of_the_folder_continues_is_left_out(tmp_path):
    later = write_continued_run(tmp_path)
    earlier = tmp_path / "run.h5"
    listed = list_run_files([tmp_path])
    assert listed.paths == [later]
    assert listed.continued == {earlier: later}
    named = list_run_files([tmp_path, earlier])
    assert named.paths == [later, earlier]
    assert named.continued == {}
    done = run_dic("process", tmp_path, *WORDS)
    assert f"{earlier} is left out, because {later} continues it and contains its steps" in done.out
    assert list(closing(done)[1]) == [str(later)]


def test_outputs_of_several_runs_are_in_folders(shelf):
    done = run_dic("process", "runs/run2.h5", "runs/run3.h5", *WORDS, "-o", "out", "--csv", "tables")
    assert done.status == 2
    made = {str(path.relative_to(shelf.parent)) for path in shelf.parent.rglob("*") if path.is_file()}
    assert {"out/run2.results.h5", "tables/run2/strain.csv"} <= made
    assert not any(name.startswith("runs/") and "results" in name for name in made)


def test_what_would_be_one_file_of_several_runs_is_refused(shelf, correlated):
    both = ("process", "runs/run2.h5", "runs/run10.h5", *WORDS)
    for option in ("--report", "--json", "--fields-from"):
        assert f"settings: {option}: expected one run, got 2 runs; leave out {option}, or" in refusal(
            *both, option, "x"
        )
    shutil.copy(shelf / "run2.h5", "run2.h5")
    (shelf / "empty").mkdir()
    assert "list runs: expected a folder with run files (*.h5), got none" in refusal(
        "process", shelf / "empty"
    )
    assert correlated == []


@pytest.mark.parametrize(
    ("other", "place", "options"),
    [
        ("runs/run2.nxs", "runs/run2.results.h5", ()),
        ("run2.h5", "out/run2.results.h5", ("-o", "out")),
        ("run2.h5", "tables/run2", ("--csv", "tables")),
        ("run2.h5", "alignments/run2", ("--save-alignment", "alignments")),
        # The result of the first run would replace the second run.
        ("runs/run2.results.h5", "runs/run2.results.h5", ()),
    ],
)
def test_two_runs_with_one_place_are_refused_even_with_force(shelf, other, place, options, correlated):
    shutil.copy(shelf / "run2.h5", other)
    said = refusal("process", "runs/run2.h5", other, *WORDS, *options, "--force")
    assert f"{place}: write results: expected a place of its own for each run, got one place for " in said
    assert all(name in said.split("one place for")[1] for name in ("runs/run2.h5", other))
    assert correlated == []
    assert not (shelf.parent / "out").exists()


def test_a_run_with_two_names_is_listed_once(shelf):
    link = shelf.parent / "link"
    link.symlink_to(shelf)
    names = ("runs/run2.h5", shelf / "run2.h5", "link/run2.h5", "runs/run10.h5")
    listed = list_run_files(list(map(Path, names))).paths
    assert listed == [Path("runs/run2.h5"), Path("runs/run10.h5")]


@pytest.mark.extended
def test_a_run_with_two_names_is_processed_once(shelf, correlated):
    link = shelf.parent / "link"
    link.symlink_to(shelf)
    done = run_dic("process", "runs/run2.h5", shelf / "run2.h5", "link/run2.h5", "runs/run10.h5", *WORDS)
    assert (done.status, len(correlated)) == (0, 2)
    assert list(closing(done)[1]) == ["runs/run2.h5", "runs/run10.h5"]


@pytest.mark.extended
def test_the_same_command_goes_on_with_force_too(shelf, correlated, monkeypatch):
    words = ("process", "runs/run2.h5", "runs/run10.h5", *WORDS, "--force")
    with monkeypatch.context() as patched:

        def interrupted(self, *given):
            raise KeyboardInterrupt

        patched.setattr("dic.pipeline.measuring.Measuring._evaluated", interrupted)
        (shelf / "run2.results.h5").write_text("an earlier result")
        assert run_dic(*words).err.strip() == f"error: {run_work.GOES_ON}"
    assert len(correlated) == 1
    assert run_dic(*words).status == 0
    assert len(correlated) == 2


@pytest.mark.extended
def test_the_same_command_goes_on_with_tables(shelf, correlated):
    words = ("process", "runs/run2.h5", "runs/run10.h5", *WORDS, "--csv", "tables", "--save-alignment", "al")
    assert run_dic(*words).status == 0
    tables = sorted((shelf.parent / "tables").rglob("*.csv"))
    whole = [table.read_bytes() for table in tables]
    (shelf / "run10.results.h5").unlink()
    for table in (shelf.parent / "tables/run10").iterdir():
        table.unlink()
    tables[-1].unlink()
    assert run_dic(*words).status == 0
    assert [table.read_bytes() for table in tables] == whole
    assert len(correlated) == 3
    tables[0].unlink()
    tables[-1].write_text("notes of the user")
    done = run_dic(*words)
    assert (done.status, tables[-1].read_text()) == (2, "notes of the user")
    assert "got one with other content; name another place, or replace it with --force" in done.err
    assert run_dic(*words, "--force").status == 0
    assert [table.read_bytes() for table in tables] == whole


def test_an_interruption_says_how_to_go_on_and_which_runs_remain(shelf, monkeypatch):
    def interrupted(self, **named):
        raise KeyboardInterrupt

    monkeypatch.setattr("dic.pipeline.run_cameras.RunCameras.calibrated", interrupted)
    done = run_dic("process", "runs/run2.h5", "runs/run10.h5", *WORDS)
    assert done.status == 2
    assert done.err.strip() == f"error: {run_work.GOES_ON}"
    heading, table = closing(done)
    assert heading == f"2 runs: 1 {run_work.NOT_PROCESSED}, 1 {run_work.NOT_BEGUN}"
    assert table["runs/run10.h5"] == ["not", "begun"]
