"""Tests with videos of known grey levels that OpenCV has written."""

import warnings

import cv2
import numpy as np
import pytest

import dic
from dic.errors import ImageError, ImageWarning
from dic.image.times import ImageTime, SeriesTimes
from dic.image.video import read_video

RATE = 12.5
FRAMES = 7
SHAPE = (96, 128)


def grey_frames(depth=np.uint8):
    return np.random.default_rng(4).integers(0, np.iinfo(depth).max + 1, (FRAMES, *SHAPE)).astype(depth)


def write_video(path, frames, codec="FFV1"):
    colour, depth = frames.ndim == 4, cv2.CV_16U if frames.dtype == np.uint16 else cv2.CV_8U
    properties = [cv2.VIDEOWRITER_PROP_IS_COLOR, int(colour), cv2.VIDEOWRITER_PROP_DEPTH, depth]
    code = cv2.VideoWriter_fourcc(*codec) if codec else 0
    writer = cv2.VideoWriter(str(path), cv2.CAP_FFMPEG, code, RATE, SHAPE[::-1], properties)
    assert writer.isOpened()
    for frame in frames:
        writer.write(frame)
    writer.release()
    return path


@pytest.mark.parametrize(
    ("name", "codec", "depth"),
    [("a.avi", "FFV1", np.uint8), ("a.mkv", "FFV1", np.uint16), ("a.avi", "", np.uint8)],
)
def test_grey_levels_of_lossless_video_are_those_that_were_written(tmp_path, name, codec, depth):
    frames = grey_frames(depth)
    video = write_video(tmp_path / name, frames, codec)
    listed = dic.list_images(video)
    assert [path.name for path in listed] == [f"{name}#{number}" for number in range(1, FRAMES + 1)]
    # In order, again, backwards and in leaps.
    for number in (*range(FRAMES), 6, 3, 2, 5, 0):
        np.testing.assert_array_equal(dic.read_image(listed[number]), frames[number])


def test_colour_is_converted_to_its_luma(tmp_path):
    frames = np.random.default_rng(5).integers(0, 256, (2, *SHAPE, 3), np.uint8)
    video = write_video(tmp_path / "a.avi", frames)
    blue, green, red = np.moveaxis(frames[1].astype(float), -1, 0)
    luma = 0.299 * red + 0.587 * green + 0.114 * blue
    np.testing.assert_allclose(dic.read_image(f"{video}#2"), luma, atol=1e-4)


def test_times_follow_from_the_rate_of_frames(tmp_path):
    video = read_video(write_video(tmp_path / "a.mkv", grey_frames()))
    np.testing.assert_allclose(video.times_s, np.arange(FRAMES) / RATE, atol=1e-9)


def test_frame_whose_time_the_file_does_not_state_has_no_time(tmp_path):
    """The last frame of an MPEG file of small frames is such a frame; OpenCV gives it the time 0."""
    path = tmp_path / "a.mpg"
    writer = cv2.VideoWriter(str(path), cv2.CAP_FFMPEG, cv2.VideoWriter_fourcc(*"mpg1"), 25.0, SHAPE[::-1])
    for k in range(FRAMES):
        writer.write(np.full((*SHAPE, 3), 20 * k, np.uint8))
    writer.release()
    times_s = read_video(path).times_s
    np.testing.assert_allclose(times_s[:-1], np.arange(FRAMES - 1) / 25.0, atol=1e-9)
    assert np.isnan(times_s[-1])
    assert SeriesTimes(f"{path}#2").of(f"{path}#{FRAMES}") == ImageTime()
    assert SeriesTimes(f"{path}#2").of(f"{path}#5").time_s == pytest.approx(0.12)


def test_lossy_codec_is_warned_of(tmp_path):
    video = write_video(tmp_path / "a.avi", grey_frames(), "MJPG")
    with pytest.warns(ImageWarning, match=r"a\.avi#1: is compressed as MJPG, which changes the grey levels"):
        assert dic.read_image(f"{video}#1").shape == SHAPE


def test_video_without_a_frame_number_gives_its_first_frame_and_says_so(tmp_path):
    frames = grey_frames()
    video = write_video(tmp_path / "a.avi", frames)
    with pytest.warns(ImageWarning, match=r"holds 7 frames, and only the first .* is named a\.avi#7"):
        np.testing.assert_array_equal(dic.read_image(video), frames[0])


def test_replaced_video_is_read_anew(tmp_path):
    frames, video = grey_frames(), tmp_path / "a.avi"
    write_video(video, frames)
    assert dic.read_image(f"{video}#1")[0, 0] == frames[0, 0, 0]
    write_video(video, frames[::-1, ::-1][:-1])
    assert len(dic.list_images(video)) == FRAMES - 1
    np.testing.assert_array_equal(dic.read_image(f"{video}#1"), frames[-1, ::-1])


@pytest.mark.parametrize("name", ["a.avi", "a.mkv"])
def test_video_that_was_cut_off_gives_its_whole_frames_and_a_warning(tmp_path, name, capfd):
    frames = grey_frames()
    video = write_video(tmp_path / name, frames)
    video.write_bytes(video.read_bytes()[: int(0.55 * video.stat().st_size)])
    with pytest.warns(ImageWarning, match=r"only \d of \d frames can be read|is damaged"):
        listed = dic.list_images(video)
    assert 2 <= len(listed) < FRAMES
    for path, frame in zip(listed[:-1], frames, strict=False):
        np.testing.assert_array_equal(dic.read_image(path), frame)
    # The decoder's own messages do not reach the terminal.
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize(
    ("content", "got"),
    [(b"", "OpenCV cannot read"), (b"RIFF....AVI LIST", "OpenCV cannot read"), (None, "No such")],
)
def test_what_is_no_video_is_refused(tmp_path, content, got):
    video = tmp_path / "a.avi"
    if content is not None:
        video.write_bytes(content)
    assert dic.list_images(video) == [video]
    with pytest.raises(ImageError, match=f"expected a frame of a video, got .*{got}"):
        dic.read_image(video)


def test_frame_beyond_the_end_is_refused(tmp_path):
    video = write_video(tmp_path / "a.avi", grey_frames())
    for number in (8, 1_000_000):
        with pytest.raises(ImageError, match="got a video with 7 frames; name a frame from 1 to 7"):
            dic.read_image(f"{video}#{number}")


def test_folder_has_no_videos_among_its_images(tmp_path):
    write_video(tmp_path / "a.avi", grey_frames())
    cv2.imwrite(str(tmp_path / "a.png"), grey_frames()[0])
    with warnings.catch_warnings(action="error"):
        assert [path.name for path in dic.list_images(tmp_path)] == ["a.png"]
