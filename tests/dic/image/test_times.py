"""Tests of the times of images: Exif tags that Pillow writes, times of files, and frames of videos."""

import os

import cv2
import numpy as np
import pytest
from PIL import Image

from dic.image.times import ImageTime, SeriesTimes
from tests.exif_files import save_taken, set_changed

GREY = Image.fromarray(np.random.default_rng(1).integers(0, 256, (64, 64), np.uint8))


def write(path, *tags, **options):
    save_taken(GREY, path, *(tags or [None]), **options)
    set_changed(path, 1_700_000_000)
    return path


@pytest.mark.parametrize("ending", ["jpg", "png", "tif"])
@pytest.mark.parametrize(
    ("before", "after", "time_s"),
    [
        (("2026:03:28 23:59:59",), ("2026:03:29 00:00:04",), 5.0),
        (("2026:02:28 23:59:59", "25"), ("2026:03:01 00:00:00", "5"), 1.25),
        (("2026:07:01 12:00:00", "000", "+02:00"), ("2026:07:01 10:30:01", "125", "+00:00"), 1801.125),
        (("2026:07:01 12:00:00", "0", "-03:30"), ("2026:07:01 12:00:00", "75", "-03:30"), 0.75),
    ],
)
def test_exif_tags_give_the_time_since_the_reference(tmp_path, ending, before, after, time_s):
    reference = write(tmp_path / f"a.{ending}", *before)
    found = SeriesTimes(reference).of(write(tmp_path / f"b.{ending}", *after))
    assert found.source == "exif"
    assert found.time_s == pytest.approx(time_s, abs=1e-6)


@pytest.mark.parametrize(
    ("first", "second"), [(None, None), ("2026:07:01 12:00:00", None), (None, "soon"), ("", "")]
)
def test_without_tags_in_both_the_last_change_of_the_files_counts(tmp_path, first, second):
    reference, image = write(tmp_path / "a.tif", first), write(tmp_path / "b.tif", second)
    set_changed(image, 1_700_000_012.25)
    found = SeriesTimes(reference).of(image)
    assert found.source == "file"
    assert found.time_s == pytest.approx(12.25, abs=1e-6)


def test_pages_have_times_only_from_their_own_tags(tmp_path):
    stack = write(tmp_path / "a.tif", save_all=True, append_images=[GREY, GREY])
    assert SeriesTimes(f"{stack}#1").of(f"{stack}#3").source == ""
    assert ImageTime().as_dict() == {}


def test_frames_have_the_time_of_the_video_since_the_reference(tmp_path):
    video = tmp_path / "a.mkv"
    writer = cv2.VideoWriter(str(video), cv2.VideoWriter_fourcc(*"FFV1"), 12.5, GREY.size, False)
    for _ in range(5):
        writer.write(np.asarray(GREY))
    writer.release()
    in_video, apart = SeriesTimes(f"{video}#2"), SeriesTimes(write(tmp_path / "a.png"))
    for number in range(1, 6):
        frame = f"{video}#{number}"
        assert in_video.of(frame).time_s == pytest.approx((number - 2) / 12.5)
        assert apart.of(frame).time_s == pytest.approx((number - 1) / 12.5)
    assert in_video.of(f"{video}#9").source == in_video.of(tmp_path / "a.png").source == ""


@pytest.mark.parametrize("ending", ["jpg", "png", "tif", "avi"])
def test_damaged_and_missing_files_have_no_time_and_raise_no_error(tmp_path, ending):
    reference = write(tmp_path / "a.png")
    image = tmp_path / f"b.{ending}"
    assert SeriesTimes(reference).of(image) == SeriesTimes(image).of(reference) == ImageTime()
    if ending != "avi":
        whole = write(tmp_path / f"c.{ending}", "2026:07:01 12:00:00", "5").read_bytes()
        for size in range(0, min(len(whole), 600), 7):
            image.write_bytes(whole[:size])
            assert SeriesTimes(image).of(image).time_s == 0.0


@pytest.mark.parametrize("ending", ["jpg", "png", "tif"])
@pytest.mark.timeout(60)
def test_huge_file_of_zeros_has_no_time_and_is_not_searched(tmp_path, ending):
    image = write(tmp_path / f"a.{ending}")
    image.write_bytes(image.read_bytes()[:64])
    os.truncate(image, 2**42)
    set_changed(image, 1_700_000_000)
    found = SeriesTimes(image).of(image)
    assert (found.time_s, found.source) == (0.0, "file")
