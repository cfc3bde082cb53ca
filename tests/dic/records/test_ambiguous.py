"""Names, numbers and options with two possible meanings are refused."""

import numpy as np
import pytest

from dic.derived import ImageClock, gauge_curve, join_record
from dic.errors import CurveError, GaugeError
from dic.gauges import GaugeImage, GaugeSeries, LineCut, PointGauge, Reading, TransverseExtensometer
from dic.properties import PropertySettings
from dic.records import MachineRecord, read_image_times, read_machine_record
from dic.records.joining import times_of

BOTH = {"off/step-1.png": 1.0, "ref/step-1.png": 2.0}


def test_images_with_equal_names_are_told_apart_by_their_folders():
    images = ["/data/ref/step-1.png", "/data/off/step-1.png"]
    assert times_of(images, BOTH, "t.csv").tolist() == [2.0, 1.0]
    windows = {name.replace("/", "\\"): time for name, time in BOTH.items()}
    assert times_of(images, windows, "t.csv").tolist() == [2.0, 1.0]
    record = MachineRecord("m.csv", np.array([10.0, 20.0]), images=tuple(BOTH))
    series, _ = join_record(GaugeSeries("r", (), tuple(map(GaugeImage, images))), record, "name")
    assert [image.known["load_n"] for image in series.images] == [20.0, 10.0]


@pytest.mark.parametrize(
    ("images", "times_s", "words"),
    [
        (["step-1.png"], BOTH, "2 lines for step-1.png"),
        (["new/step-1.png"], BOTH, "2 lines for step-1.png"),
        (["off/a.png", "ref/a.png"], {"off/a.png": 1.0}, "one line for both off/a.png and ref/a.png"),
        (["off/a.png"], {"off/a.png": np.nan}, "no time for off/a.png"),
    ],
)
def test_a_name_that_belongs_to_two_lines_is_refused(images, times_s, words):
    with pytest.raises(CurveError, match=words):
        times_of(images, times_s, "t.csv")


def read(folder, *cells):
    path = folder / "m.csv"
    path.write_text("Load;Way\n" + "".join(f"{cell};{k}\n" for k, cell in enumerate(cells)))
    return read_machine_record(path, load="Load:N").load_n.tolist()


@pytest.mark.parametrize("cells", [("900", "999", "1,001", "1,100"), ("998", "1.001")])
def test_separators_of_thousands_are_not_read_as_decimals(tmp_path, cells):
    with pytest.raises(CurveError, match="numbers whose decimals are certain, got '9"):
        read(tmp_path, *cells)


@pytest.mark.parametrize(
    ("cells", "numbers"),
    [
        (("900,000", "1001,250", "1,125"), [900.0, 1001.25, 1.125]),
        (("0", "0,125", "0,375"), [0.0, 0.125, 0.375]),
        (("1", "1.125", "1.25"), [1.0, 1.125, 1.25]),
        (("1000", "999.125", "1001"), [1000.0, 999.125, 1001.0]),
    ],
)
def test_decimals_are_still_read(tmp_path, cells, numbers):
    assert read(tmp_path, *cells) == numbers


@pytest.mark.parametrize("count", [1, 2, 3, 4])
def test_a_table_of_few_images_is_read(tmp_path, count):
    lines = ["Image;Stamp", *(f"img{k}.tif;{0.5 * k:.1f}" for k in range(count))]
    (tmp_path / "t.csv").write_text("\n".join(lines) + "\n")
    found = read_image_times(tmp_path / "t.csv", image="Image", time="Stamp:s")
    assert found == {f"img{k}.tif": 0.5 * k for k in range(count)}


def test_an_offset_is_found_from_a_gauge_along_the_specimen():
    time_s = np.arange(0.0, 30.0, 0.05)
    load = 200.0 * np.clip(time_s - 8.0, 0.0, None)
    record = MachineRecord("m.csv", load, time_s=time_s)
    at = 0.5 * np.arange(1, 50)
    strain = np.interp(at + 2.0, time_s, load) * 7e-7 + np.random.default_rng(1).normal(0, 1e-6, len(at))
    across = TransverseExtensometer(name="w", start=(1, 1), end=(50, 1), patch=5, spread=20)
    images = tuple(
        GaugeImage(
            f"i{k}",
            {
                "w": {"raw": Reading("px", strain=-0.3 * value)},
                "p": {"raw": Reading("px", strain=value)},
            },
        )
        for k, value in enumerate(strain)
    )
    clock = ImageClock(0.5, offset_s=None)
    both = GaugeSeries("r", (across, PointGauge(name="p", at=(9, 9))), images)
    joined = join_record(both, record, "time", clock=clock)[1]
    assert joined.offset_s == pytest.approx(2.0, abs=4 * joined.offset_std_s)
    cut = LineCut(name="c", start=(1, 1), end=(9, 9))
    with pytest.raises(CurveError, match="an area or a point along the specimen, got cut, transverse only"):
        join_record(GaugeSeries("r", (across, cut), images), record, "time", clock=clock)


def test_values_that_contradict_are_refused():
    with pytest.raises(CurveError, match="an interval or a table of times, got both"):
        ImageClock(interval_s=1.0, times_s={"a": 5.0})
    with pytest.raises(CurveError, match="columns of one length, got load_n 3, displacement_mm 2"):
        MachineRecord("m.csv", np.arange(3.0), displacement_mm=np.arange(2.0))


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"offsets_percent": 0.1}, "offset: expected plastic strains"),
        ({"offsets_percent": ()}, "offset: expected plastic strains"),
        ({"window_mpa": ("a", "b")}, "window: expected a lower and a higher stress"),
        ({"hardening_percent": None}, "range of hardening: expected two strains"),
    ],
)
def test_settings_of_wrong_types_are_refused_in_one_sentence(settings, words):
    with pytest.raises(CurveError, match=words):
        PropertySettings(area_mm2=1.0, **settings)


def test_a_series_without_a_measured_image_says_so():
    series = GaugeSeries("r.h5", (PointGauge(name="p", at=(9, 9)),), (GaugeImage("i", failure="dark"),))
    for ask in (lambda: series.strain("p"), lambda: gauge_curve(series, "p")):
        with pytest.raises(GaugeError, match="an image that could be measured, got none"):
            ask()
