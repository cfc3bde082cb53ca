"""A file is written completely or not at all."""

import os

import pytest
from matplotlib.figure import Figure

from dic.files.writing import replacing, write_figure, write_text
from tests.full_disk import full_disk


def _all_but(folder, *names):
    return sorted(path.name for path in folder.iterdir() if path.name not in names)


def test_a_new_file_takes_the_place_of_an_earlier_one(tmp_path):
    (tmp_path / "a.txt").write_text("old")
    write_text(tmp_path / "a.txt", "µε")
    assert (tmp_path / "a.txt").read_bytes() == "µε".encode()
    assert _all_but(tmp_path, "a.txt") == []


@pytest.mark.parametrize("failure", [OSError("disk full"), KeyboardInterrupt()])
def test_a_failure_keeps_the_earlier_file_and_leaves_no_other(tmp_path, failure):
    (tmp_path / "a.txt").write_text("old")

    def write():
        with replacing(tmp_path / "a.txt") as partial:
            partial.write_text("half")
            raise failure

    with pytest.raises(type(failure)):
        write()
    assert (tmp_path / "a.txt").read_text() == "old"
    assert _all_but(tmp_path, "a.txt") == []


def test_a_block_that_writes_nothing_keeps_the_earlier_file(tmp_path):
    (tmp_path / "a.txt").write_text("old")
    with replacing(tmp_path / "a.txt"):
        pass
    assert (tmp_path / "a.txt").read_text() == "old"


def test_a_link_stays_and_its_file_is_replaced(tmp_path):
    (tmp_path / "shelf").mkdir()
    (tmp_path / "shelf" / "a.txt").write_text("old")
    (tmp_path / "link.txt").symlink_to("shelf/a.txt")
    write_text(tmp_path / "link.txt", "new")
    assert (tmp_path / "link.txt").is_symlink()
    assert (tmp_path / "shelf" / "a.txt").read_text() == "new"


def test_a_pipe_and_a_folder_are_never_replaced(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "folder").mkdir()
    for name, kind in (("pipe", "named pipe"), ("folder", "folder")):
        with pytest.raises(OSError, match=f"a {kind}, which is never replaced"):
            write_text(tmp_path / name, "new")
    assert (tmp_path / "pipe").is_fifo()
    assert _all_but(tmp_path) == ["folder", "pipe"]


def test_a_figure_is_written_in_the_format_of_its_name(tmp_path):
    for name, begin in (("a.png", b"\x89PNG"), ("a.pdf", b"%PDF"), ("a.svg", b"<?xml")):
        write_figure(Figure(figsize=(1, 1)), tmp_path / name, dpi=50)
        assert (tmp_path / name).read_bytes().startswith(begin)


@pytest.mark.parametrize("ending", ["png", "jpg", "tif", "pdf", "svg"])
def test_a_figure_on_a_full_disk_is_an_error_and_keeps_the_earlier_file(tmp_path, ending):
    figure, path = Figure(figsize=(1, 1)), tmp_path / f"a.{ending}"
    write_figure(figure, path, dpi=50)
    whole = path.read_bytes()
    for most_bytes in (0, len(whole) // 2, len(whole) - 1):
        with full_disk(most_bytes), pytest.raises(OSError, match="File too large") as refused:
            write_figure(figure, path, dpi=50)
        assert refused.value.filename == str(path)
        assert _all_but(tmp_path, path.name) == []
        assert path.read_bytes() == whole
