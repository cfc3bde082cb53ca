"""Tests of the command `dic quality` and its output."""

import io
import signal

import cv2
import numpy as np
import pytest

from tests.command_line import refusal, run_dic
from tests.dic.correlation.sharp_patterns import discs
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
    done = run_dic("quality", *pictures, "--subset", 25, "--shape", "affine", *outputs)
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


@pytest.mark.extended
def test_the_bias_of_interpolation_and_the_smoothing_are_told(tmp_path):
    write_image(tmp_path / "sharp.png", discs(3, 0.3)(0, 0))
    for smoothing in ("auto", "0"):
        done = run_dic(
            "quality",
            tmp_path / "sharp.png",
            "--smoothing",
            smoothing,
            "--json",
            tmp_path / f"{smoothing}.json",
        )
        figures = done.report
        assert f"{1e3 * abs(figures['bias_u_px']):.2f} mpx in u" in done.out
        assert f"{1e6 * figures['bias_strain']:.0f} µε at strains up to 1 % (gauge 61 px)" in done.out
        assert (
            f"{1e3 * max(figures['unaliased_bias_u_px'], figures['unaliased_bias_v_px']):.2f} mpx if"
            in done.out
        )
        assert (figures["smoothing_px"] > 0) == (smoothing == "auto")
        assert (f"smoothing by {figures['smoothing_px']:g} px" in done.out) == (smoothing == "auto")
        if smoothing == "auto":
            assert figures["left_bias_px"] <= 0.001


def test_a_stopped_check_keeps_the_images_before(folder, tmp_path):
    class Interrupting(io.StringIO):
        def write(self, text):
            if "again.png" in text:
                signal.raise_signal(signal.SIGINT)
            return super().write(text)

    images = [folder / f"{name}.png" for name in ("again", "dull", "good")]
    command = "quality", *images, "--subset", 25, "--json", tmp_path / "q.json"
    done = run_dic(*command, out=Interrupting())
    assert done.status == 2, done
    assert "dull.png: stopped by a signal, 2 of 3 images not checked; those before it are kept" in done.err
    assert [content["image"] for content in done.report["images"]] == [str(images[0])]
    assert [failure["file"] for failure in done.report["failures"]] == [str(images[1])]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["none.png"], "none.png: read image"),
        (["good.png", "--subset", "20"], "an odd number"),
        (["good.png", "--wanted-px", "0"], "got 0"),
        (["good.png", "--shape", "cubic"], "affine or quadratic"),
        (["good.png", "--strain-range", "2"], "largest strain: expected above 0 and at most 1, got 2"),
        (["good.png", "--smoothing", "much"], "smoothing: expected auto, or between 0 and 5 px, got much"),
    ],
)
def test_what_cannot_be_judged_is_refused(folder, arguments, words):
    assert words in refusal("quality", folder / arguments[0], *arguments[1:])
