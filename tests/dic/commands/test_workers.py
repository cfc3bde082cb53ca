"""`--workers`: several processes give the bits of one, in whatever order they finish."""

import pytest

from tests.command_line import refusal, run_dic
from tests.dic.result_values import results
from tests.image_files import write_image


@pytest.fixture(scope="module")
def images(speckle, tmp_path_factory):
    """A reference and eleven images; one shows something else, and one is damaged."""
    folder = tmp_path_factory.mktemp("images")
    pattern = speckle(seed=21, shape=(120, 120))
    for number in range(12):
        shown = speckle(seed=99, shape=(120, 120)) if number == 4 else pattern
        write_image(folder / f"img{number:02d}.png", shown.draw(lambda x, y, by=0.37 * number: (x - by, y)))
    damaged = folder / "img07.png"
    damaged.write_bytes(damaged.read_bytes()[:2000])
    return folder


def test_processes_give_the_bits_of_one_processor(images, tmp_path, monkeypatch):
    monkeypatch.chdir(images.parent)
    words = ("correlate", images.name, "--subset", 21, "--step", 20)
    one, two = tmp_path / "one.h5", tmp_path / "two.h5"
    by_one, by_two = run_dic(*words, "--workers", 1, "-o", one), run_dic(*words, "--workers", 2, "-o", two)
    assert (by_one.status, by_two.status) == (2, 2)
    assert "img04.png" in by_one.err
    assert "img07.png: read image" in by_one.err
    assert (by_one.out, by_one.err) == (by_two.out, by_two.err)
    assert results(one) == results(two)


def test_number_of_workers_is_checked(images):
    assert "a number of processes, at least 1, got 0; give --workers 2" in refusal(
        "correlate", images, "--workers", 0
    )
