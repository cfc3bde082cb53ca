"""Export as TIFF: one folder per quantity, one file per image, one pixel per point of the grid."""

import json
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dic.exports.image import FIXED, Exporter, ExportImage, ExportSeries, file_name, unit_of
from dic.files.writing import replacing


class TiffExporter(Exporter):
    """Writes each quantity as 32-bit floating point; a point without a value is NaN.

    The tag ImageDescription contains, as JSON, the quantity, its unit, and the pixel positions of the points.
    """

    def __init__(self, folder: Path, series: ExportSeries) -> None:
        super().__init__(folder, series)
        self._fixed = set[str]()

    def add(self, image: ExportImage) -> None:
        """Write an image."""
        from PIL import Image

        points = image.points
        place = {
            "image": points.label,
            "x_first_px": int(points.x_px[0]),
            "y_first_px": int(points.y_px[0]),
            "step_px": _step(points.x_px if points.x_px.size > 1 else points.y_px),
        }
        for name, values in points.values.items():
            folder = self.folder / file_name(self.series.camera) / name
            if name in self._fixed:
                continue
            file = folder / f"{image.number:04d}_{image.name}.tif"
            if name in FIXED:
                self._fixed.add(name)
                file = folder / f"{name}.tif"
            folder.mkdir(parents=True, exist_ok=True)
            description = json.dumps({"quantity": name, "unit": unit_of(name), **place})
            picture = Image.fromarray(np.where(points.active, values, np.nan).astype(np.float32))
            content = BytesIO()
            picture.save(content, format="TIFF", description=description)
            with replacing(file) as partial:
                # If Pillow itself writes to a disk that becomes full, the end of the file is missing without
                # an error.
                partial.write_bytes(content.getvalue())


def _step(along: NDArray[Any]) -> int:
    return int(along[1] - along[0]) if along.size > 1 else 1
