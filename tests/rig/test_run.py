"""A run records the protocol and the rig file as it used them, and no search for garbage holds it up."""

import gc
import tomllib
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import pytest

from dic.runfile.reader import RunFile
from rig.commands.simulate import start
from rig.run import run_protocol
from tests.places import EXAMPLES, example

SHORT = ("increment_deg = 22.5", "increment_deg = 180.0")
SMALL = ('driver = "simulated-camera"', 'driver = "simulated-camera"\nwidth_px = 32\nheight_px = 24')


@pytest.fixture
def files(tmp_path) -> tuple[Path, Path]:
    """A folder with a short protocol and a rig file with small cameras."""
    protocol, rig_path = tmp_path / "protocol.toml", tmp_path / "rig.toml"
    protocol.write_text(example("rotation", SHORT))
    rig_path.write_text((EXAMPLES / "rig-virtual-rotation-10.toml").read_text().replace(*SMALL))
    return protocol, rig_path


@pytest.fixture
def replaced_once_open(monkeypatch) -> Callable[[Path], list[Path]]:
    """A function that replaces a file as soon as it is opened; the open file keeps the old content."""
    open_path = Path.open

    def arrange(path: Path) -> list[Path]:
        replaced: list[Path] = []

        def opening(self: Path, *arguments, **options):
            stream = open_path(self, *arguments, **options)
            if self == path:
                other = path.with_suffix(".other")
                with open_path(other, "w") as text:
                    text.write("this is no TOML")
                other.replace(path)
                replaced.append(path)
            return stream

        monkeypatch.setattr(Path, "open", opening)
        return replaced

    return arrange


@pytest.mark.parametrize("which", [0, 1])
def test_a_file_that_is_replaced_after_it_was_read_is_recorded_as_it_was_run(
    files, tmp_path, replaced_once_open, which
):
    protocol, rig_path = files
    texts = [path.read_bytes() for path in files]
    replaced = replaced_once_open(files[which])
    assert run_protocol(protocol, rig_path, tmp_path / "run.h5").status == "completed"
    assert replaced == [files[which]]
    with RunFile(tmp_path / "run.h5") as run:
        assert [run.info.definition.encode(), run.info.configuration.encode()] == texts
        assert [step.kind for step in run.steps] == ["grid", "reference", "rotation", "rotation"]


def test_line_ends_of_another_system_are_recorded_as_they_are(files, tmp_path):
    texts = []
    for path in files:
        path.write_bytes(path.read_bytes().replace(b"\n", b"\r\n"))
        texts.append(path.read_bytes())
    assert run_protocol(*files, tmp_path / "run.h5").status == "completed"
    with RunFile(tmp_path / "run.h5") as run:
        assert [run.info.definition.encode(), run.info.configuration.encode()] == texts


def test_a_run_is_not_held_up_by_a_search_of_the_whole_program_for_garbage(files, tmp_path):
    """Python searches all modules in some 50 to 100 ms, in which no thread goes on."""
    # commands that other tests have called in this process leave their objects out of the search
    gc.unfreeze()
    all_objects = len(gc.get_objects())
    searched: list[int] = []
    outcome = run_protocol(
        *files, tmp_path / "run.h5", on_status=[lambda _: searched.append(len(gc.get_objects()))]
    )
    assert outcome.status == "completed"
    assert max(searched) < all_objects / 4
    assert gc.get_freeze_count() == 0


def test_the_simulation_is_of_the_rig_file_that_was_found_good(files, replaced_once_open):
    rig_path = files[1]
    expected = tomllib.loads(rig_path.read_text())["cameras"]
    replaced = replaced_once_open(rig_path)
    with closing(start(rig_path, None, (), ())) as simulation:
        cameras = tomllib.loads(simulation.rig_file())["cameras"]
    assert replaced == [rig_path]
    assert set(cameras) == set(expected)
