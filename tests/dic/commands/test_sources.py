"""Files, folders and patterns that `dic correlate`, `dic quality` and `dic.measure_images` accept."""

import csv
import shutil
import warnings
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

import dic
from tests.command_line import refusal, run_dic
from tests.image_files import write_image

STRETCHES = (0.0, 0.001, 0.002, 0.004)
"""Small strains along x of the images; exx equals these numbers up to terms of second order."""
NUMBERS = (0, 1, 3, 10)
SETTINGS = dic.CorrelationSettings(subset_px=21, step_px=12)


@pytest.fixture(scope="module")
def made(speckle, tmp_path_factory):
    """A folder with a series of images, stored as single files, as JPEG files, and as pages of stack.tif."""
    folder = tmp_path_factory.mktemp("sources")
    pattern = speckle(seed=21)
    drawn = [pattern.draw(lambda x, y, s=s: (x / (1 + s), y)) for s in STRETCHES]
    (folder / "none.avi").write_text("none")
    for kind in ("series", "photos"):
        (folder / kind).mkdir()
    for number, image in zip(NUMBERS, drawn, strict=True):
        write_image(folder / "series" / f"img{number}.png", image)
        Image.fromarray(np.rint(image).astype(np.uint8)).save(
            folder / "photos" / f"img{number}.jpg", quality=95
        )
    first, *others = [Image.open(folder / "series" / f"img{number}.png") for number in NUMBERS]
    first.save(folder / "stack.tif", save_all=True, append_images=others)
    return folder


@pytest.fixture
def folder(made, monkeypatch):
    monkeypatch.chdir(made)
    return made


def measured(*arguments: object, folder: Path) -> tuple[dict[str, float], str, str]:
    """Return the strain of each image in the order of the JSON file, and the text of both output streams."""
    command = ("correlate", *arguments, "--subset", 21, "--step", 12, "--json", folder / "r.json", "--force")
    done = run_dic(*command)
    assert done.status == 0, done
    images = done.report["images"]
    return {Path(image["file"]).name: image["raw"]["exx"] for image in images}, done.out, done.err


@pytest.mark.parametrize(
    ("arguments", "names", "said"),
    [
        (["stack.tif"], "stack.tif#{page}", "the reference is stack.tif#1\n"),
        (
            ["stack.tif", "stack.tif"],
            "stack.tif#{page}",
            "stack.tif#1 is the reference, and is not measured again",
        ),
        (["series"], "img{number}.png", "the reference is series/img0.png\n"),
        (["series/img0.png", "series"], "img{number}.png", "is the reference, and is not measured again"),
        (["series/img0.png", "series/img[1-9]*.png"], "img{number}.png", ""),
        (
            ["series/img0.png", *(f"series/img{n}.png" for n in (1, 10, 3))],
            "img{number}.png",
            "in the order of",
        ),
    ],
)
def test_every_image_of_a_stack_a_folder_and_a_pattern_is_measured_in_its_order(
    folder, arguments, names, said
):
    strains, out, err = measured(*arguments, folder=folder)
    assert list(strains) == [names.format(page=page, number=NUMBERS[page - 1]) for page in (2, 3, 4)]
    assert list(strains.values()) == pytest.approx(STRETCHES[1:], abs=3e-5)
    assert said in out
    assert err == ""


def test_every_frame_of_a_video_is_measured_as_its_image_is(folder, tmp_path):
    images = [dic.read_image(f"series/img{number}.png").astype(np.uint8) for number in NUMBERS]
    writer = cv2.VideoWriter(
        str(tmp_path / "test.avi"), cv2.VideoWriter_fourcc(*"FFV1"), 25.0, images[0].shape[::-1], False
    )
    for image in images:
        writer.write(image)
    writer.release()
    strains, out, err = measured(tmp_path / "test.avi", "--csv", tmp_path / "csv", folder=folder)
    assert list(strains) == ["test.avi#2", "test.avi#3", "test.avi#4"]
    assert list(strains.values()) == list(measured("series", folder=folder)[0].values())
    assert f"the reference is {tmp_path}/test.avi#1\n" in out
    assert err == ""
    assert (tmp_path / "csv" / "test_frame4.csv").is_file()


def test_pages_have_files_of_their_own(folder, tmp_path):
    measured("stack.tif#1", "stack.tif#3", "--csv", tmp_path, folder=folder)
    assert (tmp_path / "stack_page3.csv").is_file()
    assert "stack.tif: write results" in refusal("correlate", "stack.tif", "-o", "stack.tif", "--force")


@pytest.mark.filterwarnings("always::dic.errors.ImageWarning")
def test_warning_about_jpeg_comes_once_for_a_series_and_its_strain_is_measured(folder):
    strains, _, err = measured("photos", folder=folder)
    assert err.count("is compressed as JPEG") == err.count("\n") == 1
    assert list(strains.values()) == pytest.approx(STRETCHES[1:], abs=2e-4)


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["series/img0.png"], "expected images of the deformed specimen, got none"),
        (["series/img0.png", "x*.png"], "x*.png: list images: expected a pattern that files match, got none"),
        (["missing.tif"], "missing.tif: read image: "),
        (
            ["none.avi"],
            "none.avi: read image: expected a frame of a video, got a video that OpenCV cannot read",
        ),
        (["stack.tif#1", "stack.tif#9"], "got a TIFF with 4 pages; name a page from 1 to 4"),
    ],
)
def test_what_names_no_series_is_refused(folder, arguments, sentence):
    assert sentence in refusal("correlate", *arguments)


def test_quality_checks_every_image_of_a_folder_and_a_stack(folder, tmp_path):
    done = run_dic("quality", "series/img1*.png", "stack.tif#2", "--json", tmp_path / "q.json")
    checked = [line.partition(": ")[0] for line in done.out.splitlines() if not line.startswith(" ")]
    assert checked == ["series/img1.png", "series/img10.png", "stack.tif#2"]
    assert [image["image"] for image in done.report["images"]] == checked
    same = {name: value for name, value in done.report["images"][2].items() if name != "image"}
    assert same == {name: value for name, value in done.report["images"][0].items() if name != "image"}


def test_quality_goes_on_after_an_image_that_cannot_be_checked(folder, tmp_path):
    for name in ("img1.png", "img3.png"):
        shutil.copy(folder / "series" / name, tmp_path)
    (tmp_path / "img1.png").write_bytes(b"no image")
    done = run_dic("quality", tmp_path, "--json", tmp_path / "q.json")
    assert done.status == 2
    assert [Path(failure["file"]).name for failure in done.report["failures"]] == ["img1.png"]
    assert [Path(image["image"]).name for image in done.report["images"]] == ["img3.png"]
    assert "--plot: expected one image, got 4 images" in refusal("quality", "stack.tif", "--plot", "q.png")


def test_python_takes_the_same(folder):
    found = dic.measure_images("stack.tif", settings=SETTINGS)
    assert [image.label for image in found.images] == ["stack.tif#2", "stack.tif#3", "stack.tif#4"]
    expected = [image.mean.exx for image in found.images]
    assert expected == pytest.approx(STRETCHES[1:], abs=3e-5)
    reference = dic.read_image("series/img0.png")
    for images in ("series/img[1-9]*.png", [dic.read_image(f"stack.tif#{page}") for page in (2, 3, 4)]):
        again = dic.measure_images(reference, images, settings=SETTINGS)
        assert [image.mean.exx for image in again.images] == expected
    with pytest.raises(
        dic.errors.CorrelationError, match="images: expected images of the deformed specimen, got None"
    ):
        dic.measure_images(reference, settings=SETTINGS)


def test_a_list_keeps_its_order_in_python(folder):
    files = [folder / "series" / f"img{number}.png" for number in (1, 10, 2)]
    series = dic.measure_images(folder / "series" / "img0.png", files, settings=SETTINGS)
    assert [image.label for image in series.images] == [str(file) for file in files]


def test_python_writes_the_table_of_strains(folder, tmp_path):
    (tmp_path / "a.png").write_bytes(b"no image")
    images = [*dic.list_images("series"), tmp_path / "a.png"]
    series = dic.measure_images("series/img0.png", images[1:], settings=SETTINGS)
    dic.results.write_strain_table(series.rows(), tmp_path / "strain.csv")
    with (tmp_path / "strain.csv").open(encoding="utf-8", newline="") as file:
        *measured_rows, failed = csv.DictReader(file)
    assert [float(row["raw_exx"]) for row in measured_rows] == pytest.approx(STRETCHES[1:], abs=3e-5)
    assert "another kind of file" in failed["problem"]


def test_python_warns_once_for_a_series(folder):
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        dic.measure_images("photos", settings=SETTINGS)
    assert len(said) == 1
    assert "is compressed as JPEG" in str(said[0].message)
