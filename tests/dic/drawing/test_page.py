"""The page holds the whole image, the shapes to begin with, and unchanged scripts; it needs nothing else."""

import base64
import hashlib
import json
import re

import cv2
import numpy as np
import pytest
from scipy.interpolate import RegularGridInterpolator

from dic import Calibration, read_gauges, read_region
from dic.drawing.millimetres import calibration_nodes
from dic.drawing.picture import shown_picture
from dic.gauges import Extensometer, LineCut, PointGauge, StrainGauge, TransverseExtensometer
from dic.gauges.file import gauge_text
from dic.targets import GridPoints
from tests.command_line import refusal, run_dic
from tests.image_files import write_image
from tests.places import DOCS, ROOT

ASSETS = ROOT / "dic" / "drawing" / "assets"


def data_of(page):
    return json.loads(re.search(r'id="data">(.*?)</script>', page.read_text("utf-8"), re.DOTALL)[1])


@pytest.fixture
def image(tmp_path):
    grey = np.random.default_rng(0).integers(0, 255, (120, 160)).astype(np.uint8)
    return write_image(tmp_path / "a<b>&c.png", grey)


def test_the_page_is_one_file_that_names_no_other(image, tmp_path):
    assert run_dic("draw", image, "-o", tmp_path / "draw.html").status == 0
    page = (tmp_path / "draw.html").read_text("utf-8")
    outside_of_scripts = re.sub(r"<script.*?</script>", "", page, flags=re.DOTALL)
    assert not re.search(r"(src|href)\s*=|url\(|@import", outside_of_scripts)
    assert not re.search(r"<script[^>]*src", page)
    assert "a&lt;b&gt;&amp;c.png" in outside_of_scripts
    data = data_of(tmp_path / "draw.html")
    assert (data["name"], data["width"], data["height"], data["reduction"]) == ("a<b>&c.png", 160, 120, 1)
    assert data["shapes"] == data["kept"] == []


def test_a_name_cannot_end_the_comment_in_a_file(image, tmp_path):
    strange = image.rename(tmp_path / "a\npolygons = 3.png")
    assert run_dic("draw", strange, "-o", tmp_path / "draw.html").status == 0
    assert data_of(tmp_path / "draw.html")["name"] == "a?polygons = 3.png"


def test_the_library_is_the_file_that_the_documentation_states():
    digest = hashlib.sha256((ASSETS / "konva.min.js").read_bytes()).hexdigest()
    for page in (DOCS / "regions.md", ROOT / "NOTICE"):
        assert digest in page.read_text("utf-8")
    licence = (ASSETS / "konva.LICENSE").read_text("utf-8")
    assert "Permission is hereby granted, free of charge" in licence
    assert licence.strip() in (ROOT / "NOTICE").read_text("utf-8")


@pytest.mark.parametrize("shape", [(1000, 1500), (2001, 3002)])
def test_a_reduced_picture_has_means_of_squares(shape):
    grey = np.zeros(shape, np.float32)
    grey[:, ::2] = 100.0
    grey[: shape[0] // 2] += 100.0
    uri, reduction = shown_picture(grey)
    content = base64.b64decode(uri.partition(",")[2])
    picture = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_UNCHANGED)
    assert picture.size <= 4.01e6
    assert picture.shape == tuple(-(-side // reduction) for side in shape)
    # The step in the middle lies where it does in the image, to a pixel of the picture.
    step = np.argmax(picture[:, 0] < 128)
    assert abs(step - shape[0] / 2 / reduction) <= 1.0
    if reduction % 2 == 0:
        assert np.ptp(picture[: step - 1, :-1].astype(int)) <= 1


def test_what_is_loaded_begins_the_page(image, tmp_path):
    mask = np.zeros((120, 160), np.uint8)
    mask[20:100, 30:130] = 255
    mask[50:70, 60:90] = 0
    roi = write_image(tmp_path / "mask.png", mask)
    page = tmp_path / "draw.html"
    assert run_dic("draw", image, "-o", page, "--roi", roi).status == 0
    shapes = data_of(page)["shapes"]
    assert sorted(shape["kind"] for shape in shapes) == ["hole", "region"]
    (tmp_path / "r.json").write_text(json.dumps({"polygons": [shape["points"] for shape in shapes]}))
    wrong = read_region(tmp_path / "r.json", (), mask.shape) ^ (mask > 0)
    assert not cv2.erode(wrong.astype(np.uint8), np.ones((3, 3), np.uint8)).any()


def test_gauges_in_mm_are_kept_word_for_word(image, tmp_path):
    (tmp_path / "g.toml").write_text(
        '[[gauge]]\nname = "foil"\nkind = "area"\nunit = "mm"\ncentre = [0.125, -3]\nsize = [6.0, 3.0]\n'
        'direction_deg = 90\n[[gauge]]\nname = "axial"\nkind = "extensometer"\nstart = [20, 20]\n'
        "end = [20, 100]\npatch = 10\n"
    )
    page = tmp_path / "draw.html"
    assert run_dic("draw", image, "-o", page, "--gauges", tmp_path / "g.toml").status == 0
    data = data_of(page)
    assert [shape["name"] for shape in data["shapes"]] == ["axial"]
    (kept,) = data["kept"]
    (tmp_path / "again.toml").write_text(kept["text"])
    assert read_gauges(tmp_path / "again.toml") == read_gauges(tmp_path / "g.toml")[:1]


@pytest.mark.parametrize(
    "gauge",
    [
        Extensometer(name="a", unit="mm", start=(0, -12.5), end=(0, 12.5), patch=2.25),
        TransverseExtensometer(name="w", start=(-5, 0), end=(5, 0), patch=1, spread=20.0, lines=64),
        StrainGauge(name="r", centre=(0, 0), size=(6.0, 3.0), angle_deg=30.0, direction_deg=-90),
        StrainGauge(name="p", corners=((10, 10), (90, 10), (50, 90))),
        LineCut(name="c", start=(-5, 1e-7), end=(5, 0), places=20, width=1.5),
        PointGauge(name="t", at=(1, 2)),
    ],
    ids=lambda gauge: gauge.name,
)
def test_text_of_a_gauge_declares_the_same_gauge(tmp_path, gauge):
    (tmp_path / "again.toml").write_text(gauge_text(gauge))
    assert read_gauges(tmp_path / "again.toml") == (gauge,)


def test_an_island_in_a_hole_stays_a_region(image, tmp_path):
    mask = np.zeros((120, 160), np.uint8)
    mask[10:110, 10:150] = 255
    mask[30:90, 30:130] = 0
    mask[50:70, 60:100] = 255
    roi = write_image(tmp_path / "mask.png", mask)
    assert run_dic("draw", image, "-o", tmp_path / "draw.html", "--roi", roi).status == 0
    assert [shape["kind"] for shape in data_of(tmp_path / "draw.html")["shapes"]] == ["region"] * 3


def test_millimetres_between_the_nodes_are_those_of_the_calibration():
    # A camera 30° off-axis: its exact map is a homography.
    to_px = np.array([[34.0, -2.0, 480.0], [1.5, 40.0, 500.0], [0.008, 0.001, 1.0]])
    index = np.stack(np.meshgrid(np.arange(21), np.arange(21)), axis=-1).reshape(-1, 2)
    on_target = np.column_stack([(index - 10) * 1.0, np.ones(len(index))]) @ to_px.T
    points = GridPoints.on_lattice(index, on_target[:, :2] / on_target[:, 2:], (21, 21), 1.0)
    calibration = Calibration.fit(points, (1000, 1000))
    nodes = calibration_nodes(calibration)
    (left, top), (right, bottom) = np.min(nodes["outline"], axis=0), np.max(nodes["outline"], axis=0)
    px = np.random.default_rng(1).uniform((left, top), (right, bottom), (2000, 2))
    px = px[calibration.inside(px)]
    assert len(px) > 1000
    found = RegularGridInterpolator((nodes["y"], nodes["x"]), np.array(nodes["mm"]))(px[:, ::-1])
    np.testing.assert_allclose(found, calibration.map(px), atol=0.0006)
    exact = np.column_stack([px, np.ones(len(px))]) @ np.linalg.inv(to_px).T
    np.testing.assert_allclose(found, exact[:, :2] / exact[:, 2:], atol=0.005)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--roi", "{folder}/none.toml"], "No such file"),
        (["--roi", "{folder}/far.toml"], "inside the image of 160 x 120 px"),
        (["--gauges", "{folder}/far.toml"], "got polygon"),
        (["--gauges", "{folder}/off.toml"], "places inside the image of 160 × 120 px, got (900, 1)"),
        (["--roi", "{folder}/far.toml", "--specimen"], "leave one of them out"),
        (["--calibration", "{folder}/far.toml"], "calibration"),
    ],
)
def test_bad_input_is_refused_and_no_page_is_written(image, tmp_path, options, words):
    (tmp_path / "far.toml").write_text("polygon = [[1, 1], [900, 1], [9, 9]]")
    (tmp_path / "off.toml").write_text('[[gauge]]\nname = "a"\nkind = "point"\nat = [900, 1]\n')
    page = tmp_path / "draw.html"
    given = [option.format(folder=tmp_path) for option in options]
    assert words in refusal("draw", image, "-o", page, *given)
    assert not page.exists()


def test_a_page_is_not_replaced_without_being_asked(image, tmp_path):
    (tmp_path / "draw.html").write_text("precious")
    assert "--force" in refusal("draw", image, "-o", tmp_path / "draw.html")
    assert (tmp_path / "draw.html").read_text() == "precious"
