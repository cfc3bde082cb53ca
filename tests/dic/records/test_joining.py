"""A testing machine's record is joined to images by name, row or time, and never extrapolated."""

import numpy as np
import pytest

from dic.derived import ImageClock, join_record
from dic.errors import CurveError
from dic.gauges import GaugeImage, GaugeSeries, PointGauge, Reading
from dic.records import MachineRecord, read_image_times, read_machine_record

POINT = PointGauge(name="point", at=(1, 1))
PAUSE_S, RISE_S, STEPS = 3.0, 8.0, 61
"""Duration of the hold before the test, duration of the linear rise, and number of images."""


def load_n_at(time_s):
    """Return the machine's load in N: constant at first, then rising linearly, then hardening."""
    pulled = np.maximum(time_s - PAUSE_S, 0.0)
    return 500.0 * np.minimum(pulled, RISE_S) + 80.0 * np.maximum(pulled - RISE_S, 0.0)


def strain_at(time_s):
    """Return the strain of the same test, which grows faster during hardening."""
    pulled = np.maximum(time_s - PAUSE_S, 0.0)
    return 2e-4 * np.minimum(pulled, RISE_S) + 3e-3 * np.maximum(pulled - RISE_S, 0.0)


def series_of(strain):
    images = [
        GaugeImage(f"folder/img{k:03d}.tif", {"point": {"raw": Reading("px", strain=one)}})
        for k, one in enumerate(strain)
    ]
    return GaugeSeries("r.h5", (POINT,), tuple(images))


def machine(noise_n=0.0, start_s=0.0, end_s=20.0, seed=1):
    time_s = np.arange(start_s, end_s, 0.05)
    noise = np.random.default_rng(seed).normal(0.0, noise_n, len(time_s))
    return MachineRecord("m.csv", load_n_at(time_s) + noise, time_s=time_s, displacement_mm=0.01 * time_s)


def loads(series):
    return np.array([image.known["load_n"] for image in series.images])


IMAGE_TIMES = 0.25 * np.arange(1, STEPS)
STILL = series_of(strain_at(IMAGE_TIMES))


def test_load_is_interpolated_at_the_time_of_each_image():
    series, joined = join_record(
        series_of(strain_at(IMAGE_TIMES + 1.3)), machine(), "time", clock=ImageClock(0.25, offset_s=1.3)
    )
    # The curve is made of straight lines with corners at samples, so interpolation is exact.
    np.testing.assert_allclose(loads(series), load_n_at(IMAGE_TIMES + 1.3), atol=1e-9)
    # A given offset is exact but for half a sample of the machine.
    assert (joined.join, joined.offset_s, joined.offset_std_s) == ("time", 1.3, pytest.approx(0.025))
    assert series.images[7].known["displacement_mm"] == pytest.approx(0.01 * (2.0 + 1.3))


@pytest.mark.parametrize("offset_s", [0.31, 1.77])
def test_offset_is_found_within_its_stated_uncertainty(offset_s):
    errors = []
    for seed in range(8):
        rng = np.random.default_rng([seed, 3])
        strain = strain_at(IMAGE_TIMES + offset_s) + rng.normal(0.0, 5e-6, len(IMAGE_TIMES))
        _, joined = join_record(
            series_of(strain), machine(5.0, seed=seed), "time", clock=ImageClock(0.25, offset_s=None)
        )
        assert joined.offset_std_s < 0.1
        errors.append((joined.offset_s - offset_s) / joined.offset_std_s)
    assert np.abs(errors).max() < 4.0
    assert np.sqrt(np.mean(np.square(errors))) < 2.0


def test_offset_without_images_at_rest_is_refused():
    strain = strain_at(IMAGE_TIMES + 3.5) + np.random.default_rng(4).normal(0.0, 5e-6, len(IMAGE_TIMES))
    with pytest.raises(CurveError, match="find the offset: "):
        join_record(series_of(strain), machine(5.0, 3.2), "time", clock=ImageClock(0.25, offset_s=None))


def test_offset_of_a_test_that_only_rises_evenly_is_refused():
    times = np.arange(0.0, 40.0, 0.05)
    even = MachineRecord("m.csv", 100.0 * times, time_s=times)
    rng = np.random.default_rng(2)
    strain = 1e-5 * IMAGE_TIMES + rng.normal(0.0, 1e-7, len(IMAGE_TIMES))
    with pytest.raises(CurveError, match=r"find the offset: .* give the offset with --offset-s"):
        join_record(series_of(strain), even, "time", clock=ImageClock(0.25, offset_s=None))


@pytest.mark.parametrize(
    ("offset_s", "words"),
    [
        (
            -1.0,
            "between 0 s and 19.95 s, where the machine recorded, got img000.tif at -0.75 s and 2 more",
        ),
        (5.0, "got img059.tif at 20 s"),
        (500.0, "img000.tif at 500.25 s and 59 more images outside"),
    ],
)
def test_images_that_the_machine_did_not_record_are_refused(offset_s, words):
    with pytest.raises(CurveError) as caught:
        join_record(
            series_of(strain_at(IMAGE_TIMES)), machine(), "time", clock=ImageClock(0.25, offset_s=offset_s)
        )
    assert words in str(caught.value)


def test_lines_are_found_by_the_names_of_images_with_or_without_folder_and_ending():
    names = ["C:\\test\\img002.tif", "img000", "other/img001.TIF"]
    record = MachineRecord("m.csv", np.array([30.0, 10.0, 20.0]), images=tuple(names))
    series, joined = join_record(series_of([0.0, 0.1, 0.2]), record, "name")
    assert loads(series).tolist() == [10.0, 20.0, 30.0]
    found = joined.as_dict()
    assert found.pop("join") == "name"
    assert set(found.values()) == {None}


def test_rows_belong_to_images_in_order_and_one_more_to_the_reference():
    strain = [0.0, 0.1, 0.2]
    for load_n in ([5.0, 6.0, 7.0], [0.0, 5.0, 6.0, 7.0]):
        series, _ = join_record(series_of(strain), MachineRecord("m.csv", np.array(load_n)), "row")
        assert loads(series).tolist() == [5.0, 6.0, 7.0]


@pytest.mark.parametrize(
    ("record", "join", "words"),
    [
        (MachineRecord("m.csv", np.zeros(5)), "row", "3 lines, one for each image, or one more"),
        (MachineRecord("m.csv", np.zeros(3)), "name", "a column of image names, got none"),
        (
            MachineRecord("m.csv", np.zeros(3), images=("img000", "img000", "img2")),
            "name",
            "2 lines for img000",
        ),
        (MachineRecord("m.csv", np.zeros(1), images=("img000",)), "name", "0 lines for img001"),
        (MachineRecord("m.csv", np.zeros(3)), "time", "times of all images from one source, got none"),
        (MachineRecord("m.csv", np.zeros(3)), "place", "one of name, row, time, got 'place'"),
    ],
)
def test_record_that_does_not_fit_the_images_is_refused(record, join, words):
    with pytest.raises(CurveError) as caught:
        join_record(series_of([0.0, 0.1, 0.2]), record, join)
    assert words in str(caught.value)


def test_times_of_images_may_stand_in_a_table(tmp_path):
    lines = ["Image\tStamp (ms)", *(f"img{k:03d}.tif\t{250 * (k + 1)}" for k in range(STEPS - 1))]
    (tmp_path / "times.txt").write_text("\n".join(lines))
    times_s = read_image_times(tmp_path / "times.txt", image="Image", time="Stamp:ms")
    clock = ImageClock(times_s=times_s, offset_s=1.3)
    series, _ = join_record(STILL, machine(), "time", clock=clock)
    np.testing.assert_allclose(loads(series), load_n_at(IMAGE_TIMES + 1.3), atol=1e-9)
    backwards = ImageClock(times_s={**times_s, "img010.tif": 0.1})
    with pytest.raises(CurveError, match=r"times that do not run backwards, got 0\.1 s of img010"):
        join_record(STILL, machine(), "time", clock=backwards)
    short = ImageClock(times_s={name: time for name, time in times_s.items() if name != "img059.tif"})
    with pytest.raises(CurveError, match="a time for each image, got none for img059"):
        join_record(STILL, machine(), "time", clock=short)


def test_record_of_a_machine_is_read_with_its_units(tmp_path):
    (tmp_path / "m.csv").write_text(
        "Test 7\nTime;Force;Crosshead;Image\ns;kN;mm;\n"
        "0,0;0,1;0,5;a.tif\n0,5;0,2;0,6;b.tif\n1,0;0,3;0,7;c.tif\n"
    )
    record = read_machine_record(
        tmp_path / "m.csv", load="Force:kN", displacement="Crosshead:mm", time="Time:s", image="Image"
    )
    assert record.load_n.tolist() == pytest.approx([100.0, 200.0, 300.0])
    assert record.displacement_mm.tolist() == [0.5, 0.6, 0.7]
    assert record.images == ("a.tif", "b.tif", "c.tif")


ROWS = [[0.0, 0.1, 1.0], [0.5, 0.2, 2.0], [1.0, 0.3, 3.0]]


@pytest.mark.parametrize(
    ("change", "columns", "words"),
    [
        ((1, 1, ""), {}, "load: expected a number at each point, got an empty cell"),
        ((1, 1, "x"), {}, "column 'Force': expected numbers, got 'x' in line 3"),
        ((2, 0, "0.1"), {}, "time that does not run backwards, got 0.1 s after 0.5 s at point 3"),
        ((0, 0, "0"), {"load": "Force"}, "--load: expected a column and its unit"),
        ((0, 0, "0"), {"load": "Force:kg"}, "--load: expected one of the units N, kN"),
        ((0, 0, "0"), {"load": "Weight:kN"}, "--load: expected one of the columns 'Time', 'Force', 'Way'"),
        ((0, 0, "0"), {"displacement": "Way:s"}, "--displacement: expected one of the units mm"),
    ],
)
def test_bad_record_is_refused_in_one_sentence(tmp_path, change, columns, words):
    rows = [list(map(str, row)) for row in ROWS]
    rows[change[0]][change[1]] = change[2]
    text = "\n".join(",".join(row) for row in [["Time", "Force", "Way"], *rows])
    (tmp_path / "m.csv").write_text(text)
    with pytest.raises(CurveError) as caught:
        read_machine_record(tmp_path / "m.csv", **{"load": "Force:kN", "time": "Time:s", **columns})
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


def test_an_empty_column_is_refused(tmp_path):
    (tmp_path / "m.csv").write_text("Time,Force\n" + "".join(f"{k},\n" for k in range(5)))
    with pytest.raises(CurveError):
        read_machine_record(tmp_path / "m.csv", load="Force:kN", time="Time:s")


def test_a_run_has_a_load_of_its_own():
    run = GaugeSeries("r.h5", (POINT,), (GaugeImage("load 1", known={"step": "load 1", "load_n": 3.0}),))
    with pytest.raises(CurveError, match="results of `dic correlate`, got results of a run"):
        join_record(run, MachineRecord("m.csv", np.zeros(1)), "row")


def test_rows_cannot_be_counted_where_the_places_of_failed_images_are_not_known():
    failed = GaugeSeries("r.h5", (POINT,), (GaugeImage("img0.tif", failure="dark"),), in_order=False)
    with pytest.raises(CurveError, match="images that were all measured, got 1 that were not, such as img0"):
        join_record(failed, MachineRecord("m.csv", np.zeros(1)), "row")


@pytest.mark.parametrize(
    ("sources", "got"),
    [(["", ""], "none"), (["exif", ""], "images without and times from exif"),
     (["file", "exif"], "times from exif and times from file")],
)  # fmt: skip
def test_images_without_times_of_one_source_are_not_joined_by_time(sources, got):
    known = [{"time_s": 1.0, "time_source": source} if source else {} for source in sources]
    images = tuple(GaugeImage(f"img{k}.tif", known=known[k]) for k in range(2))
    with pytest.raises(CurveError, match=f"times of all images from one source, got {got}; give"):
        join_record(GaugeSeries("r.h5", (POINT,), images), MachineRecord("m.csv", np.zeros(1)), "time")
