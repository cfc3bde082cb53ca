"""Machine code is kept only where no other user can put some, and never in a folder that is named "~"."""

import os
import stat
from pathlib import Path

import pytest

from dic.correlation.kernel import code_cache


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A function that returns the cache folder for the given environment."""
    monkeypatch.chdir(tmp_path)

    def of(home: str | None, caches: str | None = None) -> Path | None:
        for name, value in (("HOME", home), ("XDG_CACHE_HOME", caches), ("NUMBA_CACHE_DIR", None)):
            monkeypatch.delenv(name, raising=False)
            if value is not None:
                monkeypatch.setenv(name, value)
        monkeypatch.setattr(code_cache.tempfile, "tempdir", str(tmp_path / "temporary"))
        code_cache.cache_folder.cache_clear()
        return code_cache.cache_folder()

    yield of
    code_cache.cache_folder.cache_clear()


def test_home_folder_is_used_and_made_private(folder, tmp_path):
    (tmp_path / "home" / ".cache" / "offaxis").mkdir(mode=0o777, parents=True)
    found = folder(str(tmp_path / "home"))
    assert found is not None
    assert found.parent == tmp_path / "home" / ".cache" / "offaxis"
    assert stat.S_IMODE(found.parent.stat().st_mode) == 0o700


@pytest.mark.parametrize(("home", "caches"), [("~", None), ("relative", None), (None, "also/relative")])
def test_without_a_home_folder_it_is_a_private_one_with_the_number_of_the_user(
    folder, tmp_path, monkeypatch, home, caches
):
    found = folder(home, caches)
    assert found is not None
    assert found.parent == tmp_path / "temporary" / f"offaxis-{os.geteuid()}"
    assert stat.S_IMODE(found.parent.stat().st_mode) == 0o700
    assert not (tmp_path / "~").exists()


def test_own_folder_that_others_could_write_to_is_not_used(folder, tmp_path):
    """Another user may have put machine code into it before it was made private."""
    place = tmp_path / "home" / ".cache" / "offaxis"
    place.mkdir(parents=True)
    place.chmod(0o777)
    found = folder(str(tmp_path / "home"))
    assert found is not None
    assert place not in found.parents


@pytest.mark.parametrize("planted", ["folder", "link"])
def test_folder_of_another_user_or_a_link_is_not_used(folder, tmp_path, monkeypatch, planted):
    (tmp_path / "temporary").mkdir()
    user = os.geteuid()
    place = tmp_path / "temporary" / f"offaxis-{user + (planted == 'folder')}"
    if planted == "folder":
        place.mkdir()
        monkeypatch.setattr(os, "geteuid", lambda: user + 1)
    else:
        place.symlink_to(tmp_path)
    assert folder("~") is None


def test_folders_of_versions_that_were_used_longest_ago_are_removed(tmp_path):
    """The folders of other programs, and the folder that is just written, stay."""
    for age in range(20):
        place = tmp_path / f"{age:016x}"
        place.mkdir()
        os.utime(place, (1e9 - age, 1e9 - age))
    (tmp_path / "others").mkdir()
    os.utime(tmp_path / "others", (0, 0))
    code_cache.write(tmp_path / ("f" * 16) / "one.o", [b"a", b"b"])
    left = {path.name for path in tmp_path.iterdir()}
    assert left == {"f" * 16, "others", *(f"{age:016x}" for age in range(15))}
