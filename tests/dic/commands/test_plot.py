"""`dic plot` draws gauges, cuts and animations from a result file."""

import re

import cv2
import numpy as np
import pytest
from PIL import Image

from tests.command_line import refusal, run_dic
from tests.image_files import write_image

IMAGES = 4
GAUGES = """
[[gauge]]
name = "axial"
kind = "extensometer"
start = [90, 35]
end = [90, 125]
patch = 30
[[gauge]]
name = "across"
kind = "cut"
start = [40, 80]
end = [140, 80]
places = 11
"""


@pytest.fixture(scope="module")
def folder(speckle, tmp_path_factory):
    """The result file of a few images of a specimen in tension, gauges, and the machine's table."""
    folder = tmp_path_factory.mktemp("plots")
    (folder / "images").mkdir()
    pattern, lines = speckle(seed=31, noise=1.0), ["Force;Time"]
    for k in range(IMAGES + 1):

        def back(x, y, strain=0.002 * k):
            return x, 80 + (y - 80) / (1 + strain)

        write_image(folder / "images" / f"img{k:03d}.png", pattern.draw(back, noise_seed=k))
        lines.append(f"{1.5 * k};{0.5 * k}")
    (folder / "machine.csv").write_text("\n".join(lines))
    (folder / "gauges.toml").write_text(GAUGES)
    done = run_dic("correlate", folder / "images", "--subset", 21, "--step", 7, "-o", folder / "r.h5")
    assert done.status == 0, done
    return folder


def test_gauges_against_the_load_of_the_machine(folder, tmp_path):
    picture = tmp_path / "g.svg"
    record = ("--record", folder / "machine.csv", "--load", "Force:kN")
    done = run_dic(
        *("plot", "gauges", folder / "r.h5", folder / "gauges.toml", "--against", "load", *record),
        *("-o", picture),
    )
    assert (done.status, done.out.splitlines()[-1]) == (0, f"picture: {picture}"), done
    text = picture.read_text()
    assert ">load, kN<" in text
    assert ">axial, raw<" in text


def test_cuts_of_chosen_images(folder, tmp_path):
    picture = tmp_path / "c.svg"
    done = run_dic(
        *("plot", "cuts", folder / "r.h5", folder / "gauges.toml", "--images", "1,4", "-o", picture),
        *("--quantity", "v"),
    )
    assert done.status == 0, done
    shown = re.findall(r">(\d: img\d+\.png)<", picture.read_text())
    assert shown == ["1: img001.png", "4: img004.png"]


def test_an_animation_has_a_frame_for_each_image(folder, tmp_path):
    film = tmp_path / "a.gif"
    done = run_dic(
        *("plot", "animation", folder / "r.h5", "-o", film, "--frames-per-s", 2, "--on", "deformed"),
        *("--width-mm", 50, "--dpi", 72, "--record", folder / "machine.csv", "--load", "Force:kN"),
    )
    assert done.status == 0, done
    assert done.out.splitlines()[-1] == f"animation: {film}, {IMAGES} images"
    with Image.open(film) as gif:
        assert (gif.n_frames, gif.info["duration"]) == (IMAGES, 500)


def test_limits_are_the_ends_of_the_scale_of_an_animation(folder, tmp_path):
    shown = []
    for high in (10_000, 1_000_000):
        film = tmp_path / f"{high}.gif"
        done = run_dic(
            *("plot", "animation", folder / "r.h5", "-o", film, "--limits", f"eyy=-1000,{high}"),
            *("--width-mm", 50, "--dpi", 72, "--axes", "off"),
        )
        assert done.status == 0, done
        with Image.open(film) as gif:
            gif.seek(IMAGES - 1)
            pixels = np.array(gif.convert("RGB"))
        middle = pixels[pixels.shape[0] // 2, pixels.shape[1] // 3]
        shown.append(cv2.cvtColor(middle[None, None], cv2.COLOR_RGB2GRAY)[0, 0])
    # 8000 µε lies near the light end of viridis in the first film, at the dark end in the second
    assert shown[0] > shown[1] + 60


def test_gaps_are_said_and_give_status_1(folder, tmp_path, speckle):
    images = tmp_path / "images"
    images.mkdir()
    for k in range(2):
        name = f"img{k:03d}.png"
        (images / name).write_bytes((folder / "images" / name).read_bytes())
    write_image(images / "img002.png", np.full((160, 180), 90.0))  # nothing to see
    assert run_dic("correlate", images, "--subset", 21, "--step", 7, "-o", tmp_path / "r.h5").status != 0
    done = run_dic("plot", "gauges", tmp_path / "r.h5", folder / "gauges.toml", "-o", tmp_path / "g.png")
    assert done.status == 1, done
    assert done.out.splitlines()[0] == "axial, raw: no reading in 1 of 2 images"
    with Image.open(tmp_path / "g.png") as picture:
        assert picture.size == (1259, 787)  # 160 mm x 100 mm at 200 points per inch


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["gauges", "{r}", "{g}", "--against", "load"], "expected images with a load, got none"),
        (["gauges", "{r}", "{g}", "--against", "weight"], "expected one of image, time, load, got 'weight'"),
        (["gauges", "{r}"], "gauge"),
        (["gauges", "{g}", "{g}"], "result file"),
        (["gauges", "{r}", "{g}", "--width-mm", "1"], "width of plots: expected 20 to 2000 mm, got 1.0"),
        (["cuts", "{r}", "{g}", "--images", "1,x"], "whole numbers with commas between them, got 1,x"),
        (["cuts", "{r}", "{g}", "--images", "9"], "expected numbers from 1 to 4, got 9"),
        (["cuts", "{r}", "--gauge", "a=extensometer start=90,35 end=90,125 patch=30"], "expected a line cut"),
        (["animation", "{r}", "--load", "Force:kN"], "--load: expected --record beside it, got none"),
        (["animation", "{r}", "--limits", "eyy=1"], "give for example eyy=0,2000"),
        (["animation", "{r}", "--kind", "calibrated"], "a calibration, got none"),
        (["animation", "{r}", "--on", "paper"], "image under maps: expected one of reference, deformed"),
    ],
)
def test_mistakes_are_one_sentence(folder, tmp_path, words, expected):
    places = {"r": folder / "r.h5", "g": folder / "gauges.toml"}
    ending = "gif" if words[0] == "animation" else "png"
    said = refusal("plot", *(word.format(**places) for word in words), "-o", tmp_path / f"new.{ending}")
    assert expected in said
    assert list(tmp_path.iterdir()) == []


def test_a_wrong_ending_and_an_existing_file_are_refused(folder, tmp_path):
    common = ("plot", "gauges", folder / "r.h5", folder / "gauges.toml", "-o")
    assert "ends with .png, .pdf, .svg, got .gif" in refusal(*common, tmp_path / "g.gif")
    (tmp_path / "g.png").write_text("mine")
    assert "replace it with --force" in refusal(*common, tmp_path / "g.png")
    assert (tmp_path / "g.png").read_text() == "mine"
