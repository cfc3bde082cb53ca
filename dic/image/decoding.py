"""Decode checked image files with OpenCV, and keep the messages of OpenCV's libraries off the terminal."""

import os
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from dic.image.container import Container, Damage

# These are the weights of ITU-R BT.601 for blue, green and red, in OpenCV's order of channels.
_LUMA_BGR = np.array([0.114, 0.587, 0.299])
_JPEG_MESSAGES = (
    b"Corrupt JPEG data",
    b"Premature end of JPEG",
    b"Unsupported marker",
    b"Invalid SOS",
    b"Inconsistent progression sequence",
    b"Unknown Adobe color transform code",
    b"Warning: unknown JFIF revision number",
)
"""Beginnings of libjpeg's warnings about damage, and of harmless warnings.

libjpeg writes only its first warning. So a harmless warning may hide a warning about damage.
"""
_STDERR = 2
_SILENT = 0
"""OpenCV's level of its log at which it writes nothing."""
_redirecting = threading.Lock()


def decode(container: Container) -> NDArray[Any]:
    """Return the pixels of an image file as stored, shape (height, width) or (height, width, channels).

    The colours of a JPEG file are stored as luma and two differences. The luma is returned, because it is the
    grey level that `to_grey` computes. Of a PNG file, libpng checks that no pixel is missing and that the
    checksum of the pixels is right; OpenCV then gives no image.

    Raises `Damage` if the pixels cannot be decoded, or are damaged.
    """
    import cv2

    of_jpeg, of_png = (container.content.startswith(start) for start in (b"\xff\xd8", b"\x89PNG"))
    with opencv_silent(), messages_of_decoder(_is_of_library, of_jpeg or of_png) as messages:
        try:
            image: NDArray[Any] | None = cv2.imdecode(
                np.frombuffer(container.content, np.uint8),
                (cv2.IMREAD_GRAYSCALE | cv2.IMREAD_IGNORE_ORIENTATION) if of_jpeg else cv2.IMREAD_UNCHANGED,
            )
        except cv2.error:
            image = None
    if messages and (of_jpeg or image is None):
        raise Damage(f"a {'JPEG' if of_jpeg else 'PNG'} with damaged pixels ({messages[0]})")
    if image is None:
        raise Damage("one that cannot be decoded")
    return image


def to_grey(stored: NDArray[Any]) -> NDArray[np.float32]:
    """Return the grey levels of decoded pixels; the grey level of a colour is its luma (ITU-R BT.601)."""
    if stored.ndim == 2:
        return np.ascontiguousarray(stored, np.float32)
    if stored.shape[2] < 3:
        return np.ascontiguousarray(stored[..., 0], np.float32)
    grey = np.empty(stored.shape[:2], np.float32)
    # Convert one row at a time, because a whole colour image in float64 would take twelve times as much
    # memory as the grey image.
    for row, pixels in zip(grey, stored, strict=True):
        row[:] = pixels[:, :3].astype(np.float64) @ _LUMA_BGR
    return grey


@contextmanager
def opencv_silent() -> Iterator[None]:
    """Keep OpenCV's log off the terminal, because the raised error already reports the problem."""
    import cv2

    # OpenCV 4.14 has this function at another place than OpenCV 4.12.
    set_level = cv2.setLogLevel if hasattr(cv2, "setLogLevel") else cv2.utils.logging.setLogLevel
    before = set_level(_SILENT)
    try:
        yield
    finally:
        set_level(before)


def _is_of_library(line: bytes) -> bool:
    return line.startswith((*_JPEG_MESSAGES, b"libpng "))


@contextmanager
def messages_of_decoder(is_message: Callable[[bytes], bool], wanted: bool = True) -> Iterator[list[str]]:
    """Collect the messages that a decoder writes to standard error in a list, at the end of the `with` block.

    Decoders such as libjpeg fill damaged pixels with grey, and report this only by a message that they write
    to standard error. Messages that other threads write meanwhile are passed on.

    `is_message`: function that returns True for a line that the decoder writes. `wanted`: False if nothing is
    to be collected.
    """
    messages: list[str] = []
    if not wanted:
        yield messages
        return
    with _redirecting, tempfile.TemporaryFile() as taken:
        with _standard_error_to(taken):
            yield messages
        taken.seek(0)
        for line in taken.read().splitlines(keepends=True):
            if is_message(line):
                messages.append(line.decode(errors="replace").strip())
            else:
                # An error here means that nobody reads the standard error, which says nothing about the
                # image.
                with suppress(OSError):
                    os.write(_STDERR, line)


@contextmanager
def _standard_error_to(file: BinaryIO) -> Iterator[None]:
    try:
        before = os.dup(_STDERR)
    except OSError:
        # The program has no standard error, so there is nothing to collect.
        yield
        return
    try:
        if sys.stderr is not None:
            with suppress(OSError):
                sys.stderr.flush()
        os.dup2(file.fileno(), _STDERR)
        yield
    finally:
        os.dup2(before, _STDERR)
        os.close(before)
