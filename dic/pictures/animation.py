"""Files of moving pictures, written frame by frame: GIF by Pillow, MP4 by OpenCV."""

import errno
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import BinaryIO

import numpy as np

from dic.errors import OutputError
from dic.files.writing import replacing
from dic.pictures.colours import blended, colour_table
from dic.pictures.frames import UNDER
from dic.pictures.marks import Frame
from dic.pictures.settings import MapSettings, require_format
from dic.typing import PathLike

FORMATS = ("gif", "mp4")
LEAST_PER_S, MOST_PER_S = 0.01, 50.0
"""Least and largest number of frames per second. GIF counts time in 1/100 s, and viewers slow down frames
that last less than 2/100 s.
"""

_SHADES, _UNDER = 48, (0.62, 0.71, UNDER, 0.95)
"""Number of map colours in a GIF file, repeated over each of these grey levels of the image and of the colour
bar below.
"""
_HEADER_BYTES = 13
_LOOP = b"\x21\xff\x0bNETSCAPE2.0\x03\x01\x00\x00\x00"
_END = b"\x3b"
_GLOBAL_TABLE = 0x80


@contextmanager
def animation_writer(path: PathLike, per_s: float, colours: Frame) -> Iterator[Callable[[Frame], None]]:
    """Provide a function that adds a frame to a GIF or MP4 file; the file is written whole or not at all.

    One frame at a time is in memory. All frames must have the shape of the first one.

    `path`: the ending gives the format: .gif or .mp4. `per_s`: number of frames in a second. `colours`, shape
    (1, n, 3): at most 256 colours, including white. All frames of a GIF file are drawn in these colours.

    Raises `OutputError` if the format or the number is not possible, or the OpenCV of this computer writes no
    MP4, and `OSError` if the file cannot be written.
    """
    file_format = require_format(path, FORMATS)
    if not LEAST_PER_S <= per_s <= MOST_PER_S:
        expected = f"{LEAST_PER_S:g} to {MOST_PER_S:g} frames in a second"
        raise OutputError(str(path), "write an animation", expected, f"{per_s:g}", "give for example 5")
    with replacing(path) as partial:
        if file_format == "gif":
            with partial.open("wb") as file:
                gif = _Gif(file, round(100.0 / per_s), colours)
                yield gif.add
                gif.finish()
        else:
            # OpenCV chooses the format from the suffix of the file name, so the temporary file needs this
            # suffix.
            video = partial.with_name(f"{partial.name}.mp4")
            try:
                yield from _mp4(video, per_s, Path(path))
                if video.exists():
                    video.replace(partial)
            finally:
                video.unlink(missing_ok=True)


def colours_of(settings: MapSettings) -> Frame:
    """Return the 256 colours of maps, shape (1, 256, 3): the colours over several grey levels, and grey."""
    shades = colour_table(settings.colours)[np.linspace(0, 255, _SHADES).round().astype(int)]
    over = [blended(shades, settings.opacity, under) for under in _UNDER]
    greys = np.linspace(0, 255, 256 - len(_UNDER) * _SHADES).round().astype(np.uint8)
    return np.concatenate([*over, np.repeat(greys[:, None], 3, axis=1)])[None]


class _Gif:
    """Joins pictures that Pillow writes as single GIF files to one file that repeats for ever (GIF89a)."""

    def __init__(self, file: BinaryIO, hundredths: int, colours: Frame) -> None:
        from PIL import Image

        self._file, self._hundredths = file, hundredths
        self._begun = False
        self._colours = colours.tobytes()
        self._white = int((colours[0] == 255).all(axis=1).argmax())
        self._palette = Image.new("P", (1, 1))
        self._palette.putpalette(self._colours)

    def add(self, frame: Frame) -> None:
        from PIL import Image

        buffer = BytesIO()
        rounded = Image.fromarray(frame).quantize(palette=self._palette, dither=Image.Dither.NONE)
        places = np.array(rounded)
        # Pillow does not always find the nearest colour; set white pixels exactly, or the page would look
        # grey.
        places[(frame == 255).all(axis=2)] = self._white
        picture = Image.fromarray(places)
        picture.putpalette(self._colours)
        picture.save(buffer, format="gif", optimize=False)
        content = buffer.getvalue()
        flags = content[10]
        table_bytes = 3 * 2 ** ((flags & 0x07) + 1) if flags & _GLOBAL_TABLE else 0
        table = content[_HEADER_BYTES : _HEADER_BYTES + table_bytes]
        if not self._begun:
            # The logical screen has the size of the frame, and no global colour table.
            self._file.write(b"GIF89a" + content[6:10] + b"\x00\x00\x00" + _LOOP)
            self._begun = True
        body = content[_HEADER_BYTES + table_bytes :]
        start = _image_place(body)
        descriptor, pixels = body[start : start + 10], body[start + 10 :].removesuffix(_END)
        delay = self._hundredths.to_bytes(2, "little")
        self._file.write(b"\x21\xf9\x04\x04" + delay + b"\x00\x00")
        local = bytes([descriptor[9] & 0x40 | _GLOBAL_TABLE | flags & 0x07])
        self._file.write(descriptor[:9] + local + table + pixels)

    def finish(self) -> None:
        if self._begun:
            self._file.write(_END)


def _image_place(body: bytes) -> int:
    """Return the index at which the image descriptor begins, after the extension blocks of a GIF file."""
    at = 0
    while body[at] == 0x21:
        at += 2
        while body[at]:
            at += 1 + body[at]
        at += 1
    return at


def _mp4(video: Path, per_s: float, path: Path) -> Iterator[Callable[[Frame], None]]:
    """Yield a function that adds a frame to an MP4 file; then check that the file has all frames."""
    import cv2

    writers: list[cv2.VideoWriter] = []
    added = 0

    def add(frame: Frame) -> None:
        nonlocal added
        # The video codec needs an even width and height.
        even = np.pad(frame, ((0, frame.shape[0] % 2), (0, frame.shape[1] % 2), (0, 0)), mode="edge")
        if not writers:
            code = cv2.VideoWriter.fourcc(*"mp4v")
            writers.append(cv2.VideoWriter(str(video), code, per_s, even.shape[1::-1]))
            if not writers[0].isOpened():
                # OpenCV does not say why. If no file can be written, this raises the reason.
                video.write_bytes(bytes(1 << 16))
                got, remedy = f"OpenCV {cv2.__version__} without it", "give a name that ends with .gif"
                raise OutputError(str(path), "write MP4", "an OpenCV that encodes MPEG-4", got, remedy)
        writers[0].write(np.ascontiguousarray(even[..., ::-1]))
        added += 1

    try:
        yield add
    finally:
        for writer in writers:
            writer.release()
    # OpenCV reports no error of writing, such as a full disk, so read the file again.
    if writers and (written := _frames_in(video)) != added:
        raise OSError(errno.EIO, f"the disk may be full: {written} of {added} frames were written", str(path))


def _frames_in(video: Path) -> int:
    """Return the number of frames of a video file; 0 if it cannot be read."""
    import cv2

    capture = cv2.VideoCapture(str(video))
    try:
        return int(capture.get(cv2.CAP_PROP_FRAME_COUNT)) if capture.isOpened() else 0
    finally:
        capture.release()
