"""`dic quality` as a person or a script uses it."""

import cv2
import numpy as np
import pytest

from tests.command_line import refusal, run_dic
from tests.image_files import write_image


@pytest.fixture(scope="module")
def folder(speckle, tmp_path_factory):
    folder = tmp_path_factory.mktemp("quality")
    pattern = speckle(seed=3, noise=1.0)
    mask = np.zeros(pattern.shape)
    mask[20:140, 20:160] = 255
    pictures = {"good": pattern.draw(noise_seed=1), "again": pattern.draw(noise_seed=2), "mask": mask}
    pictures["dull"] = 100 + 0.1 * pictures["good"]
    for name, picture in pictures.items():
        write_image(folder / f"{name}.png", picture)
    return folder


def test_a_good_image_ends_with_0_and_tells_programs_what_it_tells_people(folder, tmp_path):
    pictures = [folder / "good.png", "--second", folder / "again.png", "--roi", folder / "mask.png"]
    outputs = ["--json", tmp_path / "q.json", "--plot", tmp_path / "q.png"]
    done = run_dic("quality", *pictures, "--subset", 25, *outputs)
    assert done.status == 0, done
    assert done.report["good"]
    assert done.report["noise"] == pytest.approx(np.sqrt(1 + 1 / 12), rel=0.05)
    assert f"{done.report['floor_px']:.4f} px at 95 %" in done.out
    assert f"a subset of {done.report['recommended_subset_px']} px" in done.out
    assert cv2.imread(str(tmp_path / "q.png")).shape == (800, 1400, 3)


def test_a_bad_image_ends_with_1_and_says_why(folder, tmp_path):
    done = run_dic("quality", folder / "dull.png", "--subset", 21, "--json", tmp_path / "q.json")
    assert done.status == 1
    assert "contrast" in done.err
    assert done.report["findings"]
    assert not done.report["good"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["none.png"], "none.png: read image"),
        (["good.png", "--subset", "20"], "an odd number"),
        (["good.png", "--wanted-px", "0"], "got 0"),
        (["good.png", "--shape", "cubic"], "affine or quadratic"),
    ],
)
def test_what_cannot_be_judged_is_refused(folder, arguments, words):
    assert words in refusal("quality", folder / arguments[0], *arguments[1:])
