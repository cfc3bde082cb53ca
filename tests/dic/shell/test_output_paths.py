"""Outputs that would destroy something, or that cannot be made, are refused before the work."""

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
    require_places([tmp_path / "in.png", None], [tmp_path / "old.h5", None, tmp_path / "new.json"])
    # Judging places makes none and takes none away.
    assert [path.name for path in tmp_path.iterdir()] == ["old.h5"]
