from pathlib import Path

import pytest

from dic import process_run, write_report
from rig.commands import demo
from rig.commands.demo import run_demo
from rig.engine.status import Outcome
from rig.errors import Aborted, RigError
from rig.run import run_protocol
from tests.dic.report.page import Page
from tests.places import EXAMPLES


def fail(*_: object) -> Outcome:
    return Outcome("aborted", "Ctrl-C", 2)


@pytest.fixture
def no_experiment(monkeypatch):
    """Replace the experiments of the demo, so that none is executed."""
    monkeypatch.setattr(demo, "run_protocol", fail)


@pytest.mark.usefixtures("no_experiment")
def test_files_that_are_no_demos_are_left_alone(tmp_path: Path):
    precious = tmp_path / "tension.h5"
    precious.write_bytes(b"a real run")
    with pytest.raises(RigError, match="a new or empty folder, or that of an earlier demo"):
        run_demo(tmp_path, print)
    assert [path.name for path in tmp_path.iterdir()] == ["tension.h5"]
    assert precious.read_bytes() == b"a real run"


@pytest.mark.usefixtures("no_experiment")
def test_folder_that_cannot_be_made_is_one_sentence(tmp_path: Path):
    (tmp_path / "file").touch()
    with pytest.raises(RigError, match=r"file/demo: expected a folder that can be written to"):
        run_demo(tmp_path / "file" / "demo", print)


@pytest.mark.usefixtures("no_experiment")
def test_experiment_that_did_not_complete_ends_the_demo_which_can_be_repeated(tmp_path: Path):
    folder = tmp_path / "demo"
    for _ in range(2):
        with pytest.raises(Aborted, match="tension: expected a completed run, got aborted"):
            run_demo(folder, print)
        assert (folder / "tension.toml").is_file()
        (folder / "tension.h5").write_bytes(b"what the first demo left")


def test_exact_properties_are_those_of_the_virtual_specimen():
    # the defaults of the virtual specimen, from the data sheet of 2024-T3
    exact = demo._exact_properties(EXAMPLES / "rig-virtual-tensile.toml")
    assert exact == {"E_gpa": 73.1, "nu": 0.33, "Rp02_mpa": 345.0}


@pytest.mark.long
def test_tensile_test_gives_the_exact_properties_from_every_camera(tmp_path: Path):
    protocol, rig = (EXAMPLES / name for name in demo.EXPERIMENTS["tensile"])
    outcome = run_protocol(protocol, rig, tmp_path / "t.h5")
    assert outcome.status == "completed"
    result = process_run(tmp_path / "t.h5")
    test = demo._tensile_test(result, EXAMPLES)
    assert [(column.camera, column.read.kind) for column in test.columns] == [
        (camera, kind) for camera in ("on_axis", "off_axis") for kind in ("calibrated", "corrected")
    ]
    corrected = test.main.properties.values
    for name, exact in test.known.items():
        value = corrected[name]
        assert abs(value.value - exact) < 2.6 * value.std < 0.02 * exact, name  # 99 %
    # A slope of 0.1 degrees that grows with the load, seen at 30 degrees, makes E about 9 GPa too low.
    uncorrected = test.columns[2].properties.values["E_gpa"]
    assert uncorrected.value < 68.0
    assert len(demo._property_lines(test)) == 3
    write_report(result, tmp_path / "report.html", tests=[test])
    page = Page((tmp_path / "report.html").read_text(encoding="utf-8"))
    fields = [caption for caption in page.captions if "on the deformed images" in caption]
    assert [caption.split(":")[0].strip() for caption in fields] == ["on_axis", "off_axis"]
    assert not any("not shown" in caption or "not measured" in caption for caption in fields)
    (hardware, analysis) = page.all_tables("settings facts")
    assert hardware[0] == analysis[0] == ["", "on_axis", "off_axis"]
    assert ["Subset size", "41 px", "41 px"] in analysis
    assert "not stated" not in next(row for row in hardware if row[0] == "Exposure time")
