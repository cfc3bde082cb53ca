"""Write image files with Exif tags by means of Pillow."""

import os
from pathlib import Path
from typing import Any

from PIL import Image
from PIL.TiffImagePlugin import ImageFileDirectory_v2

_MAKE, _EXIF, _TAKEN, _FRACTION, _OFFSET = 271, 34665, 36867, 37521, 36881


def save_taken(
    image: Image.Image,
    path: Path,
    taken: str | None,
    fraction: str | None = None,
    offset: str | None = None,
    **options: Any,
) -> Path:
    """Save an image with the Exif tags for date, fraction of a second and time zone; None omits a tag."""
    known = {_TAKEN: taken, _FRACTION: fraction, _OFFSET: offset}
    values = {tag: value for tag, value in known.items() if value is not None}
    if values and path.suffix == ".tif":
        options["tiffinfo"] = ImageFileDirectory_v2()
        options["tiffinfo"][_EXIF] = values
    elif values:
        options["exif"] = tags = Image.Exif()
        tags.get_ifd(_EXIF).update(values)
        # Pillow takes tags without one outside of the directory of Exif for none.
        tags[_MAKE] = "offaxis"
    image.save(path, **options)
    return path


def set_changed(path: Path, changed_s: float) -> None:
    """Set the time of the last change of a file."""
    os.utime(path, ns=(0, round(changed_s * 1e9)))
