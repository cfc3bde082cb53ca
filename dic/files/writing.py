"""Write files completely or not at all: an earlier file stays until the new file is complete."""

import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import Any

from dic.files.reading import kind_of


@contextmanager
def replacing(path: str | Path) -> Iterator[Path]:
    """Replace a file: the new content is written to a temporary file, which is then renamed to `path`.

    The function is a context manager that provides the path of the temporary file. The temporary file is in
    the same folder, and is renamed at the end of the `with` block. If the `with` block raises an error or
    writes no file, an existing file at `path` stays unchanged. If `path` is a link, the target of the link is
    replaced and the link stays.

    Raises `OSError` if no file can be written to the folder, or if `path` is a folder, a device or a pipe.
    Folders, devices and pipes are never replaced.
    """
    place = require_place(path)
    # The process number gives two programs that write to the same path different temporary files.
    partial = place.with_name(f".{place.name}.{os.getpid()}.partial")
    try:
        yield partial
        if not partial.exists():
            return
        with partial.open("rb+") as file:
            # Without `fsync`, a power failure after the renaming could leave an empty file.
            os.fsync(file.fileno())
        partial.replace(place)
    except OSError as error:
        if error.filename in (None, str(partial)):
            # The user does not know the temporary file. An error of a write to an open file has no name.
            error.filename = str(path)
        raise
    finally:
        partial.unlink(missing_ok=True)


def require_place(path: str | Path) -> Path:
    """Return the place of a file that may be replaced: the path, or the target of the link at the path.

    Raises `OSError` if there is a folder, a device or a pipe, which are never replaced.
    """
    # Otherwise the link itself would be replaced, and its target would stay unchanged.
    place = Path(os.path.realpath(path))
    if place.exists() and (kind := kind_of(place.stat().st_mode)):
        raise OSError(errno.EINVAL, f"{kind}, which is never replaced", str(path))
    return place


def reason(error: OSError) -> str:
    """Return the reason why a file could not be written, in the words of the operating system.

    Errors of HDF5 have long messages that do not say why a file cannot be written. For an error of HDF5 the
    result is the system's text for the error number.
    """
    if error.strerror:
        return error.strerror
    return os.strerror(error.errno) if error.errno else "an error of the file system"


def write_text(path: str | Path, text: str) -> None:
    """Write a text file in UTF-8, completely or not at all; raise `OSError` like `replacing`."""
    with replacing(path) as partial:
        partial.write_text(text, encoding="utf-8")


def write_figure(figure: Any, path: str | Path, dpi: float, image_format: str | None = None) -> None:
    """Write a matplotlib figure to a file, completely or not at all; raise `OSError` like `replacing`.

    `image_format`: format of the file, such as "png". By default the suffix of `path` determines the format.
    """
    content = BytesIO()
    image_format = image_format or Path(path).suffix.lstrip(".").lower() or "png"
    # Compressing a PNG file as much as possible takes as long as drawing it, and saves little space.
    quick = {"pil_kwargs": {"compress_level": 1}} if image_format == "png" else {}
    figure.savefig(content, dpi=dpi, format=image_format, **quick)
    with replacing(path) as partial:
        # If Pillow itself writes a JPEG or TIFF file to a disk that becomes full, the end of the file is
        # missing without an error.
        partial.write_bytes(content.getvalue())
