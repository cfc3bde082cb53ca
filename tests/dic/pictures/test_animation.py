"""Animations: one frame for each image on one scale, read again by Pillow and OpenCV."""

import re
import weakref
from dataclasses import replace

import cv2
import numpy as np
import pytest
from PIL import Image

import dic
from dic.derived import animation
from dic.files.lazy import Computed
from dic.pictures.animation import animation_writer, colours_of
from dic.pictures.maps import MapDrawer
from dic.pipeline.measured_images import MeasuredImage, MeasuredSeries
from tests.dic.pictures.fields import SHAPE, stretched
from tests.dic.pipeline.rendered_run import slid, write_rendered_run
from tests.full_disk import full_disk

GREY = np.full(SHAPE, 128.0, np.float32)
COLOURS = colours_of(dic.pictures.MapSettings())
PLAIN = dic.pictures.MapSettings(quantities=("exx",), axes="off", opacity=1.0, width_mm=40.0, dpi=100)


def series_of(*strains):
    images = [
        MeasuredImage(f"folder/image {k}.png", failure="image 1: too dark")
        if strain is None
        else MeasuredImage(f"folder/image {k}.png", dic.measure(stretched(strain)))
        for k, strain in enumerate(strains)
    ]
    return MeasuredSeries(GREY, images)


def frames_of(path):
    with Image.open(path) as gif:
        for k in range(gif.n_frames):
            gif.seek(k)
            yield np.array(gif.convert("RGB"))


def test_a_gif_has_the_frames_and_the_time_that_were_written(tmp_path):
    rng = np.random.default_rng(1)
    frames = [COLOURS[0][rng.integers(0, 256, (30, 41))] for _ in range(5)]
    with animation_writer(tmp_path / "a.gif", 4.0, COLOURS) as add:
        for frame in frames:
            add(frame)
    with Image.open(tmp_path / "a.gif") as gif:
        assert (gif.n_frames, gif.size, gif.info["loop"]) == (5, (41, 30), 0)
        for k in range(5):
            gif.seek(k)
            assert gif.info["duration"] == 250
    for frame, read in zip(frames, frames_of(tmp_path / "a.gif"), strict=True):
        # Pillow rounds to a colour near the nearest one
        assert np.abs(frame.astype(int) - read).max() <= 24


def test_a_page_stays_white_in_a_gif(tmp_path):
    frame = np.full((20, 20, 3), 255, np.uint8)
    frame[5:9] = 0
    with animation_writer(tmp_path / "a.gif", 1.0, COLOURS) as add:
        add(frame)
    (read,) = frames_of(tmp_path / "a.gif")
    assert (read[0] == 255).all()
    assert read[6].max() < 10


def test_an_mp4_has_the_frames_and_the_time_that_were_written(tmp_path):
    with animation_writer(tmp_path / "a.mp4", 8.0, COLOURS) as add:
        for level in (40, 120, 200):
            add(np.full((31, 45, 3), (level, 90, 20), np.uint8))
    video = cv2.VideoCapture(str(tmp_path / "a.mp4"))
    assert video.get(cv2.CAP_PROP_FPS) == 8.0
    for level in (40, 120, 200):
        good, frame = video.read()
        assert good
        assert frame.shape == (32, 46, 3)  # the code needs an even width and height
        np.testing.assert_allclose(frame.reshape(-1, 3).mean(axis=0), (20, 90, level), atol=8)
    assert not video.read()[0]
    assert [path.name for path in tmp_path.iterdir()] == ["a.mp4"]


def test_an_opencv_that_writes_no_mp4_is_said_in_one_sentence(tmp_path, monkeypatch):
    class Without:
        fourcc = cv2.VideoWriter.fourcc

        def __init__(self, *arguments):
            pass

        def isOpened(self):  # noqa: N802 (OpenCV's name)
            return False

        def release(self):
            pass

    monkeypatch.setattr(cv2, "VideoWriter", Without)
    with (
        pytest.raises(dic.errors.OutputError, match=r"an OpenCV that encodes MPEG-4, .*ends with \.gif"),
        animation_writer(tmp_path / "a.mp4", 5.0, COLOURS) as add,
    ):
        add(np.zeros((4, 4, 3), np.uint8))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("most_bytes", [100, 20_000])
def test_an_mp4_that_the_disk_cannot_hold_is_an_error_and_keeps_the_earlier_file(tmp_path, most_bytes):
    (tmp_path / "a.mp4").write_text("earlier")
    noise = np.random.default_rng(1).integers(0, 256, (10, 64, 64, 3), np.uint8)
    with (
        full_disk(most_bytes),
        pytest.raises(OSError, match="of 10 frames were written") as refused,
        animation_writer(tmp_path / "a.mp4", 5.0, COLOURS) as add,
    ):
        list(map(add, noise))
    assert refused.value.filename == str(tmp_path / "a.mp4")
    assert [(path.name, path.read_text()) for path in tmp_path.iterdir()] == [("a.mp4", "earlier")]


def test_a_broken_animation_keeps_the_earlier_file(tmp_path):
    (tmp_path / "a.gif").write_text("earlier")
    with (
        pytest.raises(AttributeError),
        animation_writer(tmp_path / "a.gif", 5.0, COLOURS) as add,
    ):
        add(None)
    assert [(path.name, path.read_text()) for path in tmp_path.iterdir()] == [("a.gif", "earlier")]


def test_every_image_is_a_frame_on_the_scale_of_the_series(tmp_path):
    series = series_of(0.001, 0.002, 0.001)
    done = dic.write_animation(series, tmp_path / "a.gif", settings=PLAIN, frames_per_s=2.0)
    assert (done.frames, done.failures) == (3, [])
    first, second, third = frames_of(tmp_path / "a.gif")
    middle = (7 * first.shape[0] // 10, first.shape[1] // 2)
    assert (first[middle] == third[middle]).all()
    # the whole field has one strain: the lower end of viridis, and its upper end
    np.testing.assert_allclose(first[middle], (68, 1, 84), atol=12)
    np.testing.assert_allclose(second[middle], (253, 231, 37), atol=12)


@pytest.fixture
def titles(monkeypatch):
    """The titles of all maps that are drawn."""
    given, draw = [], MapDrawer.draw

    def noted(self, maps, image, title, scale):
        given.append(title)
        return draw(self, maps, image, title, scale)

    monkeypatch.setattr(MapDrawer, "draw", noted)
    return given


def test_the_title_names_image_number_load_and_time(tmp_path, monkeypatch, titles):
    series = series_of(0.001, None)
    source = animation.sources_of(series, None)
    source = [replace(source[0], known=[{"load_n": 1234.4, "time_s": 2.5, "step": "load 3"}])]
    monkeypatch.setattr(animation, "sources_of", lambda results, camera: source)
    done = dic.write_animation(series, tmp_path / "a.gif", settings=PLAIN)
    assert titles == ["load 3 · 1 of 2 · 1234 N · 2.5 s", "image 1.png · 2 of 2 · not measured"]
    assert done.failures == ["image 1: too dark"]


def test_given_loads_are_in_the_titles_but_not_the_times_of_files(tmp_path, titles):
    known = [{"load_n": 20.0, "time_s": 1.0, "time_source": "file"}, {"load_n": np.nan, "time_s": 3.0}]
    series = series_of(0.001, 0.002)
    dic.write_animation(series, tmp_path / "a.gif", settings=PLAIN, known=known)
    assert titles == ["image 0.png · 1 of 2 · 20 N", "image 1.png · 2 of 2 · 3.0 s"]
    with pytest.raises(dic.errors.CorrelationError, match="expected values of 2 images, got 1"):
        dic.write_animation(series, tmp_path / "b.gif", settings=PLAIN, known=known[:1])


@pytest.mark.long
def test_the_deformed_images_of_a_run_come_from_its_file(tmp_path):
    run = write_rendered_run(tmp_path / "run.h5", [slid(0.02), slid(0.04)])
    results = dic.process_run(run, settings=dic.CorrelationSettings(subset_px=31, step_px=15))
    films = []
    for on in ("reference", "deformed"):
        dic.write_animation(results, tmp_path / f"{on}.gif", settings=replace(PLAIN, on=on, axes="px"))
        films.append(list(frames_of(tmp_path / f"{on}.gif")))
    assert len(films[0]) == len(films[1]) == 2
    rows, columns = (min(film[1].shape[side] for film in films) for side in (0, 1))
    assert (films[0][1][:rows, :columns] != films[1][1][:rows, :columns]).any()
    run.unlink()
    with pytest.raises(dic.errors.RunFileError, match="no such file"):
        dic.write_animation(results, tmp_path / "c.gif", settings=replace(PLAIN, on="deformed", axes="px"))


def test_on_the_deformed_image_the_view_holds_still_and_each_frame_has_its_image(tmp_path):
    series = series_of(0.001, 0.05)
    for k, level in enumerate((40, 220)):
        picture = np.full(SHAPE, level, np.uint8)
        picture[0, 0], picture[0, 1] = 0, 255  # the range of grey levels
        cv2.imwrite(str(tmp_path / f"{k}.png"), picture)
    images = [replace(image, label=str(tmp_path / f"{k}.png")) for k, image in enumerate(series.images)]
    settings = replace(PLAIN, on="deformed")
    dic.write_animation(replace(series, images=images), tmp_path / "a.gif", settings=settings)
    first, second = frames_of(tmp_path / "a.gif")
    assert first.shape == second.shape
    # the colour bar lies above the maps
    coloured = [np.ptp(frame[60:].astype(int), axis=2).max(axis=0) > 40 for frame in (first, second)]
    ends = [np.flatnonzero(columns)[[0, -1]] for columns in coloured]
    # the cells reach from 30 to 270 px; at 5 % they end 13.2 px further to the right than at 0.1 %
    share = (ends[0][1] - ends[0][0] + 1) / (1.001 * 240)
    assert ends[1][1] - ends[0][1] == pytest.approx(0.049 * 270 * share, abs=1)


def test_the_view_in_mm_is_the_same_for_all_frames(tmp_path):
    index = np.stack(np.meshgrid(np.arange(17), np.arange(17)), axis=-1).reshape(-1, 2)
    uv = index * (17.0, -13.0) + (14.0, 224.0)
    calibration = dic.Calibration.fit(dic.targets.GridPoints.on_lattice(index, uv, (17, 17), 0.75), SHAPE)
    images = [
        MeasuredImage(f"{k}", dic.measure(stretched(strain), calibration))
        for k, strain in enumerate((0.0, 0.05))
    ]
    for k in range(2):
        cv2.imwrite(str(tmp_path / f"{k}.png"), np.random.default_rng(k).integers(0, 255, SHAPE, np.uint8))
    images = [replace(image, label=str(tmp_path / f"{k}.png")) for k, image in enumerate(images)]
    settings = replace(PLAIN, on="deformed", axes="mm")
    dic.write_animation(MeasuredSeries(GREY, images), tmp_path / "a.gif", settings=settings)
    first, second = frames_of(tmp_path / "a.gif")
    assert first.shape == second.shape


def test_no_more_than_a_few_images_are_in_memory_at_a_time(tmp_path):
    measured, alive = [], []

    def image(k):
        measurement = dic.measure(stretched(1e-4 * (1 + k)))
        measured.append(weakref.ref(measurement))
        alive.append(sum(each() is not None for each in measured))
        return MeasuredImage(f"{k}", measurement)

    dic.write_animation(MeasuredSeries(GREY, Computed(5, image)), tmp_path / "a.gif", settings=PLAIN)
    assert len(measured) >= 10  # at least once for the scale, and once for the frame
    assert max(alive) <= 3


def test_frames_of_a_gif_are_written_one_by_one(tmp_path):
    rng, sizes = np.random.default_rng(2), []
    with animation_writer(tmp_path / "a.gif", 5.0, COLOURS) as add:
        (partial,) = tmp_path.iterdir()
        for _ in range(4):
            add(COLOURS[0][rng.integers(0, 256, (200, 200))])
            sizes.append(partial.stat().st_size)
    assert (np.diff(sizes) > 20_000).all()


@pytest.mark.parametrize(
    ("how", "error", "words"),
    [
        ({"frames_per_s": 0.0}, dic.errors.OutputError, "expected 0.01 to 50 frames in a second, got 0"),
        (
            {"settings": replace(PLAIN, kind="corrected")},
            dic.errors.CorrelationError,
            "corrected values in maps",
        ),
        ({"camera": "left"}, dic.errors.RunFileError, "leave the camera out"),
    ],
)
def test_what_cannot_be_animated_is_refused(tmp_path, how, error, words):
    with pytest.raises(error, match=re.escape(words)):
        dic.write_animation(series_of(0.001), tmp_path / "a.gif", **({"settings": PLAIN} | how))
    assert list(tmp_path.iterdir()) == []


def test_a_series_without_values_and_a_wrong_ending_are_refused(tmp_path):
    with pytest.raises(dic.errors.CorrelationError, match="expected an image with values of exx, got none"):
        dic.write_animation(series_of(None), tmp_path / "a.gif", settings=PLAIN)
    with pytest.raises(dic.errors.OutputError, match=r"ends with \.gif, \.mp4, got \.avi"):
        dic.write_animation(series_of(0.001), tmp_path / "a.avi", settings=PLAIN)
    assert list(tmp_path.iterdir()) == []
