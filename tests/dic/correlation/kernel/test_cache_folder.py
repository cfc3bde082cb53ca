"""Machine code is kept only where no other user can put some, and never in a folder that is named "~"."""

import os
import stat
from pathlib import Path

import pytest

from dic.correlation.kernel import jit


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A function that returns the cache folder for the given environment."""
    monkeypatch.chdir(tmp_path)

    def of(home: str | None, caches: str | None = None) -> Path | None:
        for name, value in (("HOME", home), ("XDG_CACHE_HOME", caches)):
            monkeypatch.delenv(name, raising=False)
            if value is not None:
                monkeypatch.setenv(name, value)
        monkeypatch.setattr(jit.tempfile, "tempdir", str(tmp_path / "temporary"))
        jit._cache_folder.cache_clear()
        return jit._cache_folder()

    yield of
    jit._cache_folder.cache_clear()


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


def test_without_a_folder_the_machine_code_is_only_in_memory(monkeypatch):
    monkeypatch.setattr(jit, "_cache_folder", lambda: None)
    monkeypatch.setattr(jit.numba.config, "CACHE_DIR", "")
    assert jit.compiled(lambda a: a + 1.0)(2.0) == 3.0
