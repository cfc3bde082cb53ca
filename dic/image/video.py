"""Frames of video files, which OpenCV decodes one after another; one frame is in memory at a time."""

import os
import threading
from dataclasses import dataclass
from functools import lru_cache
from math import nan
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dic.files.reading import require_regular
from dic.image.container import MOST_PIXELS, Damage
from dic.image.decoding import messages_of_decoder, opencv_silent

ENDINGS = (".avi", ".mkv", ".mp4", ".m4v", ".mov", ".mpg", ".mpeg", ".webm", ".wmv")
"""Endings of the names of video files, in small or capital letters."""

_LOSSLESS = {"FFV1", "FFVH", "HFYU", "MPNG", "PNG", "LAGS", "MAGY", "ULRG", "ULRA", "ULY0", "ULY2", "ULY4"}
_UNCOMPRESSED = {"", "RAW", "DIB", "Y800", "GREY", "Y8", "Y16", "I420", "IYUV", "YUY2", "UYVY", "NV12"}
_GREY = {"Y800", "GREY", "Y1\0\x10"}
"""Pixel formats of 8 and 16 bits whose grey levels OpenCV returns as stored.

OpenCV converts frames of other formats to colours.
"""
_REMEDY = "convert it to images, for example with `ffmpeg -i VIDEO img%05d.png`"


@dataclass(frozen=True)
class Video:
    """The properties of a video file, after all its frames have been counted."""

    times_s: tuple[float, ...]
    """Time of each frame since the first frame, as the file states it; NaN if the file does not state it."""
    declared: int
    """Number of frames that the file declares; 0 if it declares none."""
    codec: str
    """Four letters, such as "FFV1"; "" for uncompressed frames."""
    lossy: bool
    """True if the codec changes grey levels, as JPEG does, or is not known."""
    errors: tuple[str, ...]
    """Messages of the decoder about damaged frames."""

    def __len__(self) -> int:
        return len(self.times_s)

    @property
    def problem(self) -> str:
        """A warning that says what is wrong with the video; "" for an undamaged video."""
        # In some formats, the declared number of frames is an estimate. So accept a difference of one frame.
        if self.declared - len(self) > 1:
            return f"only {len(self)} of {self.declared} frames can be read; these are used"
        if self.errors:
            return f"is damaged ({self.errors[0]}); frames near the damage may show wrong grey levels"
        return ""


def is_video(file: Path) -> bool:
    """Return True if the name of a file ends as those of videos do."""
    return file.suffix.lower() in ENDINGS


def read_video(file: Path) -> Video:
    """Read a whole video, and return its properties. The file is read again only if it has changed.

    Raises `OSError` if there is no such file, and `Damage` if OpenCV cannot read the video.
    """
    return _read_video(*_identity(file))


def read_frame(file: Path, number: int) -> NDArray[Any]:
    """Return a frame as OpenCV decodes it, shape (height, width) or (height, width, 3).

    Frames are numbered from 1. If frames are read in their order, each frame is decoded once. If an earlier
    frame is read, the video is decoded again from its beginning, because many videos cannot be opened exactly
    at a frame in the middle.

    Raises `OSError` if there is no such file, and `Damage` if OpenCV cannot read the video, or if the video
    has fewer frames.
    """
    global _last
    video, identity = read_video(file), _identity(file)
    if not 1 <= number <= len(video):
        raise Damage(f"a video with {len(video)} frames", f"name a frame from 1 to {len(video)}")
    # The decoder's messages about damage were already collected when the frames were counted.
    with _reading, messages_of_decoder(_is_of_ffmpeg):
        if _last is None or _last.identity != identity or number < _last.number:
            _last = _Reader(identity)
        return _last.frame(number)


def _identity(file: Path) -> tuple[str, int, int]:
    require_regular(file)
    found = file.stat()
    return os.path.realpath(file), found.st_size, found.st_mtime_ns


@lru_cache(maxsize=8)
def _read_video(path: str, size: int, changed_ns: int) -> Video:
    import cv2

    with messages_of_decoder(_is_of_ffmpeg) as errors:
        capture, times_s = _opened(path), []
        while capture.grab():
            times_s.append(capture.get(cv2.CAP_PROP_POS_MSEC) / 1000.0)
    if not times_s:
        raise Damage("a video without a frame that OpenCV can read", _REMEDY)
    codec = _letters(capture.get(cv2.CAP_PROP_FOURCC))
    lossy = codec.upper() not in _LOSSLESS | _UNCOMPRESSED
    declared = max(0, int(capture.get(cv2.CAP_PROP_FRAME_COUNT)))
    return Video(_since_first(times_s), declared, codec, lossy, tuple(errors))


def _since_first(times_s: list[float]) -> tuple[float, ...]:
    """Return times since the first frame; NaN for a time that is not after all earlier ones.

    OpenCV gives the time 0 for a frame whose time the file does not state, such as the last one of an MPEG
    file.
    """
    latest_s, found = times_s[0], [0.0]
    for time_s in times_s[1:]:
        found.append(time_s - times_s[0] if time_s > latest_s else nan)
        latest_s = max(latest_s, time_s)
    return tuple(found)


def _is_of_ffmpeg(line: bytes) -> bool:
    return line.startswith(b"[") and b" @ 0x" in line


class _Reader:
    """An open video, and the frame that was read from it last."""

    def __init__(self, identity: tuple[str, int, int]) -> None:
        self.identity, self.number = identity, 0
        self._capture = _opened(identity[0])
        self._frame: NDArray[Any] | None = None

    def frame(self, number: int) -> NDArray[Any]:
        """Return a frame; `number` must not be below the number of the frame that was returned last."""
        while self.number < number:
            self._frame = None
            if not self._capture.grab():
                raise Damage(f"a video that ends after {self.number} frames", _REMEDY)
            self.number += 1
        if self._frame is None:
            found, frame = self._capture.retrieve()
            if not found:
                raise Damage(f"a video whose frame {number} cannot be decoded", _REMEDY)
            self._frame = np.asarray(frame)
        return self._frame


_reading = threading.Lock()
_last: _Reader | None = None
"""The video that was read last. This video stays open, so that its next frame can be decoded at once."""


def _opened(path: str) -> Any:
    import cv2

    with opencv_silent():
        capture = cv2.VideoCapture(path, cv2.CAP_FFMPEG)
    if not capture.isOpened():
        raise Damage("a video that OpenCV cannot read", _REMEDY)
    width, height = (int(capture.get(name)) for name in (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT))
    if width * height > MOST_PIXELS:
        raise Damage(f"frames of {width} × {height} px, more than {MOST_PIXELS // 10**6} megapixels", _REMEDY)
    if _letters(capture.get(cv2.CAP_PROP_CODEC_PIXEL_FORMAT)) in _GREY:
        capture.set(cv2.CAP_PROP_CONVERT_RGB, 0)
    return capture


def _letters(code: float) -> str:
    """Return the four letters of a codec or a pixel format."""
    return "".join(chr(int(code) >> shift & 0xFF) for shift in (0, 8, 16, 24)).strip("\0 ")
