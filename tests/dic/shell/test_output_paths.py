"""Output paths that would overwrite a file or cannot be written are refused before the work."""

import os
from pathlib import Path

import pytest

from dic.errors import OutputError
from dic.shell.output_paths import require_places


@pytest.mark.parametrize(
    ("inputs", "outputs", "got"),
    [
        (["in.png"], ["in.png"], "one that is read"),
        (["in.png"], ["sub/../in.png"], "one that is read"),
        (["link.png"], ["in.png"], "one that is read"),
        ([], ["a.h5", None, "a.h5"], "one that holds other results"),
        ([], ["sub"], "a folder"),
        ([], ["none/a.h5"], "no such folder"),
        ([], ["in.png/a.h5"], "no such folder"),
    ],
)
def test_a_place_that_cannot_be_is_named(tmp_path, inputs, outputs, got):
    (tmp_path / "sub").mkdir()
    (tmp_path / "in.png").touch()
    (tmp_path / "link.png").symlink_to("in.png")
    with pytest.raises(OutputError, match=got) as refused:
        require_places([tmp_path / name for name in inputs], [name and tmp_path / name for name in outputs])
    assert refused.value.source == str(tmp_path / outputs[-1])


def test_places_of_their_own_are_fine(tmp_path):
    (tmp_path / "old.h5").touch()
    outputs = [tmp_path / "old.h5", None, tmp_path / "new.json"]
    require_places([tmp_path / "in.png", None], outputs, force=True)
    # Judging places makes none and takes none away.
    assert [path.name for path in tmp_path.iterdir()] == ["old.h5"]


def test_earlier_results_are_kept_unless_the_user_says_otherwise(tmp_path):
    (tmp_path / "old.h5").touch()
    with pytest.raises(OutputError, match="one that exists; name another place, or replace it with --force"):
        require_places([], [tmp_path / "old.h5"])


@pytest.mark.parametrize("force", [False, True])
def test_special_files_are_never_replaced(tmp_path, force):
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "link").symlink_to("pipe")
    for place, kind in ((tmp_path / "pipe", "a named pipe"), (tmp_path / "link", "a named pipe")):
        with pytest.raises(OutputError, match=kind):
            require_places([], [place], force=force)
    with pytest.raises(OutputError, match="a device"):
        require_places([], [Path("/dev/null")], force=force)


def test_a_link_that_leads_to_itself_is_refused(tmp_path):
    (tmp_path / "a.h5").symlink_to("a.h5")
    with pytest.raises(OutputError, match="a link that leads to itself"):
        require_places([], [tmp_path / "a.h5"], force=True)
