"""The times at which images were taken, relative to the reference image, and the sources of these times."""

from dataclasses import dataclass
from math import isfinite, nan
from os.path import realpath
from pathlib import Path
from typing import Any

from dic.image.container import Damage
from dic.image.exif import taken_s
from dic.image.pages import split_page
from dic.image.video import is_video, read_video
from dic.typing import PathLike


@dataclass(frozen=True)
class ImageTime:
    """When an image was taken."""

    time_s: float | None = None
    """Time since the reference image. For a frame of a video, if the reference is not in the same video: time
    since the first frame. None if the time is not known, so that two unknown times are equal; NaN would not
    equal itself.
    """
    source: str = ""
    """Source of the time. For "video", it is the time that the file gives each frame. For "exif", it is the
    tag DateTimeOriginal. For "file", it is the last change of the file, which is late by the time of writing.
    The source is "" if the time is not known.
    """

    def as_dict(self) -> dict[str, Any]:
        """Return `time_s` and `time_source` for tables and JSON; an empty dict if the time is not known."""
        return {} if self.time_s is None else {"time_s": self.time_s, "time_source": self.source}


class SeriesTimes:
    """The times of images, relative to their reference: an image, or a page of a file."""

    def __init__(self, reference: PathLike) -> None:
        self._reference = Path(reference)
        self._file, self._page = split_page(reference)
        self._taken_s = None if is_video(self._file) else taken_s(self._file, self._page or 1)

    def of(self, image: PathLike) -> ImageTime:
        """Return the time of an image from the best source that the image shares with the reference.

        The time of a file that cannot be read is unknown. The reader of the image reports the reason.
        """
        file, page = split_page(image)
        try:
            if is_video(file):
                return self._of_frame(file, page or 1)
            if is_video(self._file):
                return ImageTime()
            taken = None if self._taken_s is None else taken_s(file, page or 1)
            if taken is not None and self._taken_s is not None:
                return ImageTime(taken - self._taken_s, "exif")
            if page is None and self._page is None:
                changed_ns = file.stat().st_mtime_ns - self._file.stat().st_mtime_ns
                return ImageTime(changed_ns / 1e9, "file")
        except (OSError, Damage):
            pass
        # The time of the last change says nothing about pages, because all pages of a file share this time.
        return ImageTime()

    def _of_frame(self, file: Path, frame: int) -> ImageTime:
        times_s = read_video(file).times_s
        if frame > len(times_s):
            return ImageTime()
        first = (self._page or 1) if realpath(file) == realpath(self._file) else 1
        start_s = times_s[first - 1] if first <= len(times_s) else nan
        time_s = times_s[frame - 1] - start_s
        return ImageTime(time_s, "video") if isfinite(time_s) else ImageTime()
