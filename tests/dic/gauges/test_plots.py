"""Pictures of gauges and line cuts show the values of a known deformation, with units and gaps."""

from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

import dic
from dic.gauges import cut_plot, plot
from tests.dic.gauges.exact_fields import exact_field, exact_series, stretched

STRAINS = np.array([0.001, 0.002, 0.003, 0.004])
AXIAL = dic.gauges.Extensometer(name="axial", start=(150, 80), end=(150, 320), patch=40)
FOIL = dic.gauges.StrainGauge(name="foil", centre=(150, 200), size=(80, 80), direction_deg=90.0)
ACROSS = dic.gauges.LineCut(name="across", start=(40, 200), end=(260, 200), places=23)
"""A cut whose places are points of the field."""
BEND = 1e-5


def bent(x, y):
    """A strain that grows along x: u = BEND x² / 2."""
    return 0.5 * BEND * x**2, 0.0 * y


def of_strains(gauges, strains=STRAINS, **lost):
    fields = [exact_field(stretched(np.diag([1.0, 1.0 + strain]))) for strain in strains]
    series = dic.measure_gauges(exact_series(*fields), gauges)
    images = [
        replace(image, known={"load_n": 500.0 * (k + 1), "time_s": 2.0 * k})
        for k, image in enumerate(series.images)
    ]
    for k in lost.get("images", ()):
        images[k] = replace(images[k], readings={}, failure="too dark")
    for k in lost.get("loads", ()):
        images[k] = replace(images[k], known={"time_s": 2.0 * k, "load_n": np.nan})
    return replace(series, images=tuple(images))


@pytest.fixture
def drawn(monkeypatch):
    """Return a function that draws a picture, and gives its figure and what the function returned."""

    def draw(function, series, **how):
        figures = []
        module = plot if function is dic.gauges.plot_gauges else cut_plot
        monkeypatch.setattr(module, "write_plot", lambda figure, *rest: figures.append(figure))
        said = function(series, "picture.svg", **how)
        return figures[0], said

    return draw


def lines_of(axis):
    return {line.get_label(): line for line in axis.lines if not line.get_label().startswith("_")}


def test_gauges_are_drawn_against_the_load_in_micro_strain(drawn):
    figure, said = drawn(dic.gauges.plot_gauges, of_strains((AXIAL, FOIL)), against="load")
    (axis,) = figure.axes
    lines = lines_of(axis)
    assert set(lines) == {"axial, raw", "foil, raw"}
    assert (axis.get_xlabel(), axis.get_ylabel()) == ("load, kN", "engineering strain, µε")
    for line in lines.values():
        np.testing.assert_allclose(line.get_xdata(), [0.5, 1.0, 1.5, 2.0])
        np.testing.assert_allclose(line.get_ydata(), STRAINS * 1e6, rtol=1e-6)
    assert said == []


def test_small_loads_are_drawn_in_newtons_and_large_strains_in_percent(drawn):
    series = of_strains((AXIAL,), strains=(0.05,))
    figure, _ = drawn(dic.gauges.plot_gauges, series, against="load")
    (axis,) = figure.axes
    (line,) = lines_of(axis).values()
    assert (axis.get_xlabel(), axis.get_ylabel()) == ("load, N", "engineering strain, %")
    assert line.get_xdata()[0] == pytest.approx(500.0)
    assert line.get_ydata()[0] == pytest.approx(5.0)


@pytest.mark.parametrize(
    ("against", "x", "label"),
    [("image", [1, 2, 3, 4], "number of the image"), ("time", [0.0, 2.0, 4.0, 6.0], "time, s")],
)
def test_gauges_are_drawn_against_the_number_of_the_image_or_time(drawn, against, x, label):
    figure, _ = drawn(dic.gauges.plot_gauges, of_strains((AXIAL,)), against=against)
    (axis,) = figure.axes
    (line,) = lines_of(axis).values()
    np.testing.assert_allclose(line.get_xdata(), x)
    assert axis.get_xlabel() == label


def test_extensions_have_the_unit_of_their_lengths(drawn):
    figure, _ = drawn(dic.gauges.plot_gauges, of_strains((AXIAL, FOIL)), quantity="extension")
    (axis,) = figure.axes
    (line,) = lines_of(axis).values()  # an area has no extension
    np.testing.assert_allclose(line.get_ydata(), STRAINS * 240.0, rtol=1e-6)
    assert axis.get_ylabel() == "extension, px"


def test_the_band_is_the_95_percent_interval(drawn):
    series = of_strains((AXIAL,))
    figure, _ = drawn(dic.gauges.plot_gauges, series)
    (band,) = figure.axes[0].collections
    _, std = series.strain("axial")
    heights = band.get_paths()[0].vertices[:, 1]
    assert heights.max() == pytest.approx(1e6 * (STRAINS[-1] + 1.959964 * std[-1]), rel=1e-6)
    assert heights.min() == pytest.approx(1e6 * (STRAINS[0] - 1.959964 * std[0]), rel=1e-6)


def test_images_without_a_reading_or_a_load_leave_gaps_and_are_named(drawn):
    series = of_strains((AXIAL,), images=[1], loads=[2])
    figure, said = drawn(dic.gauges.plot_gauges, series, against="load")
    (line,) = lines_of(figure.axes[0]).values()
    np.testing.assert_array_equal(np.isfinite(line.get_ydata()), [True, False, True, True])
    np.testing.assert_array_equal(np.isfinite(line.get_xdata()), [True, True, False, True])
    assert said == ["axial, raw: no reading in 1 of 4 images, no load for 1 of 4 images"]
    assert "gap: no reading or no load" in figure.legends[0].get_title().get_text()


def test_cameras_and_kinds_are_lines_of_their_own(drawn):
    series = of_strains((AXIAL,))
    raw = series.images[0].readings["axial"]["raw"]
    both = {"axial": {"raw": raw, "calibrated": replace(raw, strain=0.0015, unit="mm")}}
    images = [replace(series.images[0], readings=both, known={"camera": name}) for name in ("left", "right")]
    figure, _ = drawn(
        dic.gauges.plot_gauges, replace(series, images=tuple(images)), kinds=("raw", "calibrated")
    )
    lines = lines_of(figure.axes[0])
    assert set(lines) == {
        f"axial, {camera}, {kind}" for camera in ("left", "right") for kind in ("raw", "calibrated")
    }
    looks = {(line.get_linestyle(), line.get_marker()) for line in lines.values()}
    assert len(looks) == 4  # all have the colour of their gauge


def test_colours_differ_in_lightness_for_every_kind_of_vision():
    from dic.pictures.plots import COLOURS

    rgb = np.array([[int(colour[k : k + 2], 16) for k in (1, 3, 5)] for colour in COLOURS]) / 255.0
    # Machado, Oliveira and Fernandes (2009): complete deuteranopia
    deuteranope = np.array([[0.367, 0.861, -0.228], [0.280, 0.673, 0.047], [-0.012, 0.043, 0.969]])
    seen = rgb @ deuteranope.T
    apart = np.linalg.norm(seen[:, None] - seen, axis=-1)[np.triu_indices(len(COLOURS), 1)]
    assert apart.min() > 0.12


def test_a_cut_shows_the_formula_of_the_strain_along_the_line(drawn):
    series = dic.measure_gauges(exact_series(exact_field(bent)), (ACROSS,))
    figure, said = drawn(dic.gauges.plot_cuts, series, quantity="exx")
    (axis,) = figure.axes
    (line,) = lines_of(axis).values()
    x = np.linspace(40.0, 260.0, 23)
    np.testing.assert_allclose(line.get_xdata(), x - 40.0)
    gradient = BEND * x
    np.testing.assert_allclose(line.get_ydata(), 1e6 * (gradient + 0.5 * gradient**2), rtol=1e-3)
    assert (axis.get_xlabel(), axis.get_ylabel()) == ("distance along the cut, px", "εxx raw, µε")
    assert said == []


def test_a_place_without_points_leaves_a_gap_in_a_cut(drawn):
    lost = [(row, column) for row in range(14, 23) for column in range(9, 14)]
    series = dic.measure_gauges(exact_series(exact_field(bent, lost=lost)), (ACROSS,))
    figure, _ = drawn(dic.gauges.plot_cuts, series, quantity="exx")
    (line,) = lines_of(figure.axes[0]).values()
    known = np.isfinite(line.get_ydata())
    assert known[[0, -1]].all()
    assert not known[9:11].any()
    # matplotlib draws the band in pieces, one on each side of the gap
    (band,) = figure.axes[0].collections[:1]
    assert len(band.get_paths()) == 2


def test_displacements_in_different_units_are_not_drawn_on_one_axis(drawn):
    (image,) = dic.measure_gauges(exact_series(exact_field(bent)), (ACROSS,)).images
    raw = image.readings["across"]["raw"]
    both = {"across": {"raw": raw, "calibrated": replace(raw, unit="mm")}}
    series = dic.gauges.GaugeSeries("", (ACROSS,), (replace(image, readings=both),))
    kinds = ("raw", "calibrated")
    with pytest.raises(dic.errors.GaugeError, match="draw u: expected values in one unit, got mm and px"):
        dic.gauges.plot_cuts(series, "picture.svg", quantity="u", kinds=kinds)
    figure, _ = drawn(dic.gauges.plot_cuts, series, quantity="exx", kinds=kinds)  # a strain has no unit
    assert len(lines_of(figure.axes[0])) == 2


def test_a_long_series_is_shown_by_eight_measured_images_of_a_cut(drawn):
    strains = np.linspace(1e-4, 2e-3, 20)
    series = of_strains((ACROSS,), strains=strains, images=[0, 10, 19])
    figure, said = drawn(dic.gauges.plot_cuts, series)
    lines = lines_of(figure.axes[0])
    assert [label.split(":")[0] for label in lines] == ["2", "4", "7", "9", "12", "14", "17", "19"]
    assert said == []
    figure, said = drawn(dic.gauges.plot_cuts, series, images=[20, 5])
    assert [label.split(":")[0] for label in lines_of(figure.axes[0])] == ["5"]
    assert said == ["across: no values in image 19"]


def test_text_stays_text_in_svg_and_the_size_is_that_on_paper(tmp_path):
    series = of_strains((AXIAL,))
    dic.gauges.plot_gauges(
        series, tmp_path / "g.svg", settings=dic.pictures.PlotSettings(width_mm=90.0, height_mm=60.0)
    )
    text = (tmp_path / "g.svg").read_text()
    for words in ("engineering strain, µε", "number of the image", "axial, raw"):
        assert f">{words}<" in text
    points = 72.0 / 25.4
    assert f'width="{90.0 * points:.6f}'[:10] in text
    dic.gauges.plot_gauges(
        series, tmp_path / "g.png", settings=dic.pictures.PlotSettings(90.0, 60.0, dpi=254)
    )
    with Image.open(tmp_path / "g.png") as picture:
        assert picture.size == (900, 600)
    dic.gauges.plot_gauges(series, tmp_path / "g.pdf")
    assert (tmp_path / "g.pdf").read_bytes().startswith(b"%PDF")


@pytest.mark.parametrize(
    ("how", "words"),
    [
        ({"against": "load"}, "expected images with a load, got none; give the machine's record"),
        ({"against": "place"}, "choose against: expected one of image, time, load, got 'place'"),
        ({"quantity": "eyz"}, "choose quantity: expected one of strain, .*got 'eyz'"),
        ({"quantity": "e1"}, "a gauge that has e1, got gauges: extensometer"),
        ({"kinds": ("corrected",)}, "expected one of raw, got 'corrected'"),
    ],
)
def test_what_cannot_be_drawn_is_refused_in_one_sentence(tmp_path, how, words):
    series = of_strains((AXIAL,), loads=range(4))
    with pytest.raises(dic.errors.GaugeError, match=words):
        dic.gauges.plot_gauges(series, tmp_path / "g.png", **how)
    assert list(tmp_path.iterdir()) == []


def test_wrong_kinds_of_gauges_images_and_files_are_refused(tmp_path):
    cuts, gauges = of_strains((ACROSS,)), of_strains((AXIAL,))
    with pytest.raises(dic.errors.GaugeError, match="draw line cuts with `dic plot cuts`"):
        dic.gauges.plot_gauges(cuts, tmp_path / "g.png")
    with pytest.raises(dic.errors.GaugeError, match="expected a line cut, got gauges: extensometer"):
        dic.gauges.plot_cuts(gauges, tmp_path / "g.png")
    with pytest.raises(dic.errors.GaugeError, match="expected numbers from 1 to 4, got 5"):
        dic.gauges.plot_cuts(cuts, tmp_path / "g.png", images=[5])
    with pytest.raises(dic.errors.GaugeError, match="an image that could be measured, got none"):
        dic.gauges.plot_cuts(of_strains((ACROSS,), images=range(4)), tmp_path / "g.png")
    with pytest.raises(dic.errors.OutputError, match=r"ends with \.png, \.pdf, \.svg, got \.jpg"):
        dic.gauges.plot_cuts(cuts, tmp_path / "g.jpg")
    with pytest.raises(dic.errors.CorrelationError, match="height of plots: expected 20 to 2000 mm, got 5"):
        dic.pictures.PlotSettings(height_mm=5.0)
    assert list(tmp_path.iterdir()) == []
