"""If images are added to a measured folder, only the new images are correlated, with identical results."""

import shutil

import numpy as np
import pytest

from tests.command_line import refusal, run_dic
from tests.dic.result_values import bits, results
from tests.image_files import write_image

WORDS = ("--subset", 21, "--step", 20)


@pytest.fixture(scope="module")
def images(speckle, tmp_path_factory):
    """A folder with a reference and seven images, of which the third shows nothing."""
    folder = tmp_path_factory.mktemp("images")
    pattern = speckle(seed=21, shape=(160, 160))
    for number in range(8):
        moved = pattern.draw(lambda x, y, by=0.37 * number: (x - by, y))
        write_image(folder / f"img{number}.png", np.full((160, 160), 128.0) if number == 3 else moved)
    return folder


def copied(images, folder, last):
    """Copy the images up to the number `last` to a folder, with the times of the files."""
    folder.mkdir(exist_ok=True)
    for number in range(last + 1):
        shutil.copy2(images / f"img{number}.png", folder)
    return folder


@pytest.mark.parametrize(
    "incremental",
    ["auto", pytest.param("always", marks=pytest.mark.extended)],
)  # fmt: skip
def test_appended_images_alone_are_correlated_and_the_bits_are_those_of_a_whole_run(
    images, incremental, tmp_path, correlated, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    words = ("correlate", "images", *WORDS, "--incremental", incremental, "-o")
    copied(images, tmp_path / "images", 4)
    assert run_dic(*words, "r.h5").status == 2
    copied(images, tmp_path / "images", 7)
    assert run_dic(*words, "whole.h5").status == 2
    correlated.clear()
    done = run_dic(*words, "r.h5")
    assert (
        "r.h5: holds the first 4 of 7 images; their fields are used again, and 3 are correlated\n" in done.out
    )
    assert len(correlated) == 3
    assert results(tmp_path / "r.h5") == results(tmp_path / "whole.h5")
    assert not (tmp_path / ".r.h5.lock").exists()


def test_other_output_files_of_a_shorter_series_are_replaced_by_force(
    images, tmp_path, correlated, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    words = ("correlate", "images", *WORDS, "--json", "r.json", "-o")
    copied(images, tmp_path / "images", 2)
    assert run_dic(*words, "r.h5").status == 0
    copied(images, tmp_path / "images", 3)
    correlated.clear()
    # The table in the way is that of the shorter series.
    assert "r.json: write results: " in refusal(*words, "r.h5")
    done = run_dic(*words, "r.h5", "--force")
    assert len(correlated) == 1
    assert (len(done.report["images"]), len(done.report["failures"])) == (2, 1)


def test_result_of_a_shorter_series_stays_if_the_settings_differ(images, tmp_path, correlated, monkeypatch):
    monkeypatch.chdir(tmp_path)
    words = ("correlate", "images", *WORDS, "-o", "r.h5")
    copied(images, tmp_path / "images", 2)
    assert run_dic(*words).status == 0
    before = bits(tmp_path / "r.h5")
    copied(images, tmp_path / "images", 4)
    correlated.clear()
    for other in (("--strain-window", 5), ("--min-zncc", 0.7)):
        assert "one that exists; name another place, or replace it with --force" in refusal(*words, *other)
    # The first image is another one, so the series is another one too.
    shutil.copy2(images / "img5.png", tmp_path / "images" / "img1.png")
    assert "one that exists" in refusal(*words)
    assert correlated == []
    assert bits(tmp_path / "r.h5") == before
