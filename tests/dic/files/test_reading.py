"""Pipes, devices, folders and files that are far too large are refused at once."""

import os
import socket

import pytest

from dic.files.reading import read_bytes, read_text, require_regular


def test_a_regular_file_is_read_whole(tmp_path):
    (tmp_path / "a").write_bytes(b"\xef\xbb\xbf5,6\n")
    assert read_bytes(tmp_path / "a") == b"\xef\xbb\xbf5,6\n"
    assert read_text(tmp_path / "a") == "5,6\n"


def test_a_named_pipe_without_a_writer_is_refused_instead_of_awaited(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    for read in (read_bytes, require_regular):
        with pytest.raises(OSError, match="a named pipe, not a file"):
            read(tmp_path / "pipe")


@pytest.mark.parametrize("place", ["/dev/zero", "/dev/stdin"])
def test_a_device_without_an_end_is_refused(place):
    with pytest.raises(OSError, match=r"not a file|such device"):
        read_bytes(place)


def test_a_socket_a_folder_and_a_circle_of_links_are_refused(tmp_path):
    with socket.socket(socket.AF_UNIX) as listening:
        listening.bind(str(tmp_path / "socket"))
        (tmp_path / "a").symlink_to("b")
        (tmp_path / "b").symlink_to("a")
        for name in ("socket", ".", "a"):
            with pytest.raises(OSError, match=r"socket|such device|folder|symbolic links"):
                read_bytes(tmp_path / name)


def test_a_file_beyond_its_bound_is_refused_before_it_is_read(tmp_path):
    with (tmp_path / "huge").open("wb") as file:
        file.truncate(2**40)  # sparse: no disk holds it
    with pytest.raises(OSError, match="1048576 MB, more than 1024 MB"):
        read_bytes(tmp_path / "huge")


def test_a_file_that_reports_no_size_is_bounded_too():
    # /proc reports size 0 for files that have content
    with pytest.raises(OSError, match="more than"):
        read_bytes("/proc/self/maps", most_bytes=10)
