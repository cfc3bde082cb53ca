"""The names of images: files of folders and patterns in natural order, pages of TIFF files, video frames."""

import glob
import os
import re
import warnings
from collections.abc import Callable, Iterable, Sequence
from decimal import Decimal
from pathlib import Path

from dic.errors import ImageError, ImageWarning
from dic.files.reading import opened
from dic.image.channels import series_of_pages
from dic.image.container import Damage
from dic.image.numbering import missing_numbers
from dic.image.tiff import SIGNATURES as TIFFS, pages_of_file
from dic.image.video import is_video, read_video
from dic.typing import PathLike

ENDINGS = (".png", ".tif", ".tiff", ".bmp", ".pgm", ".ppm", ".pnm", ".jpg", ".jpeg")
"""Endings of file names, in small or capital letters, by which the images in a folder are recognised."""

_PAGE = re.compile(r"(.+)#([1-9]\d{0,6})", re.DOTALL)
_MOST_SHOWN = 8
"""Largest number of gaps that a warning names."""
_PARTS = re.compile(r"(\d+)", re.ASCII)
_DECIMALS = re.compile(r"((?<![\d.,])\d+[.,]\d+(?![.,]?\d)|\d+)", re.ASCII)
_FRACTION = re.compile(r"(?<![\d.,])(\d+)[.,](\d+)(?![.,]?\d)", re.ASCII)
_SIGNS = ("-", "\u2212")
_SHELLS: tuple[Callable[[Path], str], ...] = (
    str,
    lambda path: str(path).casefold(),
    lambda path: re.sub(r"[\W_]", "", str(path)).casefold(),
)
"""Keys by which shells list names: by characters, without regard to capitals, and without regard to signs."""


def split_page(path: PathLike) -> tuple[Path, int | None]:
    """Return the file and the page of a name such as ``stack.tif#3``; None if the name has no page number.

    If a file with exactly this name exists, the name is not split.
    """
    found = _PAGE.fullmatch(str(path))
    # Use os.path, because Path.exists raises an error for a name that is too long or in a closed folder.
    if found is None or os.path.exists(path):  # noqa: PTH110
        return Path(path), None
    return Path(found[1]), int(found[2])


def page_name(file: Path, page: int) -> Path:
    """Return the name of a page; the first page has the number 1."""
    return file.with_name(f"{file.name}#{page}")


def natural_key(path: PathLike, *, decimals: bool = False) -> list[tuple[int | Decimal, str]]:
    """Return a key that sorts names with numbers by the values of the numbers: img2 before img10.

    With `decimals`, a point or a comma between two numbers stands before decimals: l_0.5 after l_0.25.
    """
    stem = _without_ending(path)
    parts = (_DECIMALS if decimals else _PARTS).split(stem)
    parts[-1] += str(path)[len(stem) :]
    # Text and numbers alternate, so the same position of two keys always holds the same kind of part.
    return [(_value(part), part) if number % 2 else (0, part.casefold()) for number, part in enumerate(parts)]


def in_natural_order(paths: Iterable[Path]) -> list[Path]:
    """Return paths in the natural order of their names, in which numbers may be negative or have decimals.

    Cameras with a trigger number the frames before it below zero: c_-2, c_-1, c_0, c_1. A hyphen before a
    number is its sign after an underscore, bracket or equals sign, or if another name has a number without a
    hyphen at this place. Otherwise it only separates, as in img-1, img-2.
    """
    paths = list(paths)
    texts = [_without_ending(path) for path in paths]
    decimals = _have_decimals(texts)
    numbers = _DECIMALS if decimals else _PARTS
    before = {text[: each.start()].casefold() for text in texts for each in numbers.finditer(text)}

    def key(path: Path) -> list[tuple[int | Decimal, str]]:
        text = _without_ending(path)
        parts = natural_key(path, decimals=decimals)
        for place, each in enumerate(numbers.finditer(text)):
            prefix = text[: each.start() - 1]
            signed = text[: each.start()].endswith(_SIGNS) and not prefix[-1:].isdigit()
            if signed and (prefix.endswith(("_", "(", "[", "=")) or prefix.casefold() in before):
                number, shown = parts[2 * place + 1]
                # the texts of both kinds of name are equal then, so that their numbers are compared
                parts[2 * place] = (0, parts[2 * place][1][:-1])
                parts[2 * place + 1] = (-number, shown)
        return parts

    return sorted(paths, key=key)


def _have_decimals(texts: Sequence[str]) -> bool:
    """Return whether points or commas in names stand before decimals, as in l_0, l_0.5, l_1.

    In 1.8, 1.9, 1.10 they separate whole numbers: no program that leaves out zeros at the end writes 1.10.
    """
    found = [_FRACTION.findall(each) for each in texts]
    fractions = [fraction for each in found for _, fraction in each]
    wholes = {int(whole) for each in found for whole, _ in each}
    if len({len(fraction) for fraction in fractions}) < 2:
        return bool(fractions)
    # cam1.2, cam1.11: the same number before all points is that of a camera, and the others count images.
    if all(found) and len(wholes) == 1 and wholes != {0}:
        return False
    return not any(len(fraction) > 1 and fraction.endswith("0") for fraction in fractions)


def _without_ending(path: PathLike) -> str:
    """Return a path without the ending of its name, whose point is none of a number."""
    path = Path(path)
    return str(path.with_suffix("") if path.suffix.lower() in ENDINGS else path)


def _value(text: str) -> int | Decimal:
    return Decimal(text.replace(",", ".")) if "." in text or "," in text else int(text)


def list_images(*sources: PathLike) -> list[Path]:
    """Return the names of the images that files, folders and patterns give, in order.

    A folder gives all its image files. A pattern such as ``img*.tif`` gives the files that match it. The
    files of a folder or pattern are in the natural order of their names (img2 before img10). A TIFF file of
    several pages gives all its pages, ``stack.tif#1``, ``stack.tif#2`` and so on, except smaller copies of
    pages. A video gives all its frames, ``test.avi#1`` and so on. Sources in alphabetical order (img1, img10,
    img2), as a shell lists them, are also put in natural order.

    Parameters
    ----------
    *sources : path

    Raises
    ------
    ImageError
        If a folder contains no image, if no file matches a pattern, or if a TIFF file has several channels.

    Warns
    -----
    ImageWarning
        If numbers are missing among the names of a folder or pattern, or frames of a video cannot be read.
    """
    given = [Path(source) for source in sources]
    if any(given == sorted(given, key=key) for key in _SHELLS):
        given = in_natural_order(given)
    found = [page for source in given for file in _files(source) for page in _pages(file)]
    for page in found:
        _require_text(page)
    return found


def _require_text(path: Path) -> None:
    """Raise an error for a name that no result file could hold, such as one from an archive in Latin-1."""
    try:
        str(path).encode()
    except UnicodeEncodeError:
        shown = str(path).encode("utf-8", "backslashreplace").decode()
        expected, got = "a name in UTF-8, the encoding of this system", "one in another encoding"
        raise ImageError(shown, "list images", expected, got, "rename the file") from None


def _files(source: Path) -> Sequence[Path]:
    # Use os.path, because Path.is_dir and Path.exists raise an error for a name that is too long. The reader
    # of the file reports such a name later.
    if os.path.isdir(source):  # noqa: PTH112
        files = [path for path in source.iterdir() if path.suffix.lower() in ENDINGS and _is_shown(path)]
        expected = f"a folder with images ({', '.join(ENDINGS)})"
    elif not os.path.exists(source) and glob.has_magic(str(source)):  # noqa: PTH110
        # Use glob, because Path.glob does not accept absolute patterns.
        files = [path for path in map(Path, glob.glob(str(source), recursive=True)) if path.is_file()]  # noqa: PTH207
        expected = "a pattern that files match"
    else:
        return [source]
    if not files:
        raise ImageError(str(source), "list images", expected, "none", "name the images, or another place")
    missing = missing_numbers(files)
    if missing:
        shown = ", ".join([*missing[:_MOST_SHOWN], *(["…"] if len(missing) > _MOST_SHOWN else [])])
        warnings.warn(f"{source}: {shown} missing; the other images are used", ImageWarning, stacklevel=4)
    return in_natural_order(files)


def _is_shown(path: Path) -> bool:
    return path.is_file() and not path.name.startswith(".")


def _pages(file: Path) -> Sequence[Path]:
    """Return the names of the pages or frames of a file; if the file cannot be read, return its own name."""
    try:
        number = _frames(file) if is_video(file) else _pages_of_tiff(file)
    except (OSError, Damage):
        number = 1
    return [file] if number == 1 else [page_name(file, page) for page in range(1, number + 1)]


def _pages_of_tiff(file: Path) -> int:
    with opened(file) as content:
        if content[:4] not in TIFFS:
            return 1
        pages = pages_of_file(content)
        series, what = series_of_pages(content, pages)
    if len(series) > 1:
        shown = [f"{page_name(file, page)}" for page in series[0]]
        ends = shown if len(shown) <= _MOST_SHOWN else [*shown[: _MOST_SHOWN - 1], "…"]
        raise ImageError(
            str(file),
            "list images",
            "one series of images",
            f"{what}: {len(series)} series of {len(shown)} images each",
            f"save one series alone, or name its pages, those of the first being {' '.join(ends)}",
        )
    # the reader of the image tells of a file without pages
    return max(1, len(pages))


def _frames(file: Path) -> int:
    video = read_video(file)
    if video.problem:
        warnings.warn(f"{file}: {video.problem}", ImageWarning, stacklevel=5)
    return len(video)
