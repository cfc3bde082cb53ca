"""Exports for NumPy and MATLAB: one file per image, with one array per quantity, and the units."""

import json
from collections.abc import Mapping
from typing import Any

import numpy as np

from dic.exports.image import Exporter, ExportImage, units
from dic.files.writing import replacing


class NumpyExporter(Exporter):
    """Writes one compressed `.npz` file per image, which `numpy.load` reads with ``allow_pickle=False``."""

    def add(self, image: ExportImage) -> None:
        """Write an image."""
        arrays = _arrays(image)
        texts = {
            "label": image.points.label,
            "units": json.dumps(units(arrays)),
            "about": json.dumps({**self.series.about, **image.known}),
        }
        content: dict[str, Any] = arrays | {name: np.array(text) for name, text in texts.items()}
        with replacing(self.folder / f"{image.name}.npz") as partial, partial.open("wb") as file:
            np.savez_compressed(file, **content)


class MatlabExporter(Exporter):
    """Writes one `.mat` file per image, in format version 5, which every MATLAB and Octave can read."""

    def add(self, image: ExportImage) -> None:
        """Write an image."""
        from scipy.io import savemat

        arrays = _arrays(image)
        content: Mapping[str, Any] = {
            **arrays,
            "active": arrays["active"].astype(np.uint8),
            "label": image.points.label,
            "units": units(arrays),
            "about": {**self.series.about, **image.known},
        }
        with replacing(self.folder / f"{image.name}.mat") as partial:
            savemat(str(partial), content, False, do_compression=True, long_field_names=True)


def _arrays(image: ExportImage) -> dict[str, Any]:
    """Return the arrays of an image, shape (rows, columns), beginning with the points' x and y in px."""
    points = image.points
    x_px, y_px = np.meshgrid(points.x_px, points.y_px)
    return {"x_px": x_px, "y_px": y_px, "active": points.active, **points.values}
