from pathlib import Path

import pytest

from rig.commands import demo
from rig.commands.demo import run_demo
from rig.engine.status import Outcome
from rig.errors import Aborted, RigError


def fail(*_: object) -> Outcome:
    return Outcome("aborted", "Ctrl-C", 2)


@pytest.fixture(autouse=True)
def no_experiment(monkeypatch):
    """No experiment is run: these tests are about what stands around them."""
    monkeypatch.setattr(demo, "run_protocol", fail)


def test_files_that_are_no_demos_are_left_alone(tmp_path: Path):
    precious = tmp_path / "tension.h5"
    precious.write_bytes(b"a real run")
    with pytest.raises(RigError, match="a new or empty folder, or that of an earlier demo"):
        run_demo(tmp_path, print)
    assert [path.name for path in tmp_path.iterdir()] == ["tension.h5"]
    assert precious.read_bytes() == b"a real run"


def test_folder_that_cannot_be_made_is_one_sentence(tmp_path: Path):
    (tmp_path / "file").touch()
    with pytest.raises(RigError, match=r"file/demo: expected a folder that can be written to"):
        run_demo(tmp_path / "file" / "demo", print)


def test_experiment_that_did_not_complete_ends_the_demo_which_can_be_repeated(tmp_path: Path):
    folder = tmp_path / "demo"
    for _ in range(2):
        with pytest.raises(Aborted, match="tension: expected a completed run, got aborted"):
            run_demo(folder, print)
        assert (folder / "tension.toml").is_file()
        (folder / "tension.h5").write_bytes(b"what the first demo left")
