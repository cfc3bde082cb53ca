"""Maps of displacement and strain, drawn over the reference image."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from dic.errors import MEASURE_FIRST, require_kind
from dic.files.writing import write_figure
from dic.image.given import grey_image
from dic.out_of_plane.correction import Correction
from dic.strain.measurement import Measurement
from dic.typing import Float, ImageLike, PathLike

MICRO = 1e6


def panels(measurement: Measurement, correction: Correction | None = None) -> list[tuple[str, Float]]:
    """Return the titles and values of the five maps of a measurement: two displacements, three strains in µε.

    The maps show corrected values if the image was corrected, else calibrated values, else raw values.
    """
    if correction is not None and correction.declined is None:
        shown, strain, kind = correction.displacement, correction.strain, "corrected"
    else:
        shown, strain = measurement.calibrated or measurement.raw, measurement.strain
        kind = "calibrated" if measurement.calibrated is not None else "raw"
    vector = np.where(measurement.field.converged[..., None], shown.vector, np.nan)
    x, y = ("U", "V") if shown.unit == "mm" else ("u", "v")
    return [
        (f"{x} to the right, {shown.unit}", vector[..., 0]),
        (f"{y} upwards, {shown.unit}", vector[..., 1]),
        (f"εxx {kind}, µε", strain.exx * MICRO),
        (f"εyy {kind}, µε", strain.eyy * MICRO),
        (f"εxy {kind}, µε", strain.exy * MICRO),
    ]


def draw_maps(
    measurement: Measurement, image: NDArray[Any], title: str, correction: Correction | None = None
) -> Any:
    """Return a matplotlib figure with five maps, of displacement and strain, over the reference image.

    Each colour scale spans the 1st to the 99th percentile, so that single extreme points do not stretch the
    scale.

    Parameters
    ----------
    measurement : Measurement
    image : ndarray, shape (height, width)
        The reference image, in which the points are defined.
    title : str
    correction : Correction, optional
        Correction of the measurement. If the image was corrected, the maps show corrected values instead of
        calibrated ones.
    """
    from matplotlib.figure import Figure

    height, width = image.shape
    columns = 5 if height >= width else 3
    rows = -(-5 // columns)
    side = 3.0 if columns == 5 else 4.2
    figure = Figure(figsize=(side * columns, side * rows * height / width * 0.86 + 0.9), layout="constrained")
    figure.suptitle(title)
    axes = figure.subplots(rows, columns, squeeze=False).ravel()
    low, high = np.percentile(image, (1, 99.5))
    for axis, (name, values) in zip(axes, panels(measurement, correction), strict=False):
        axis.imshow(image, cmap="gray", vmin=low, vmax=high)
        _overlay(figure, axis, measurement, values)
        axis.set_title(name, fontsize=9)
    for axis in axes:
        axis.set_axis_off()
    return figure


def _overlay(figure: Any, axis: Any, measurement: Measurement, values: Float) -> None:
    field = measurement.field
    known = values[np.isfinite(values)]
    limits = np.percentile(known, (1, 99)) if known.size else (0.0, 1.0)
    mesh = axis.pcolormesh(
        field.x_px, field.y_px, values, shading="nearest", cmap="turbo", alpha=0.75,
        vmin=limits[0], vmax=limits[1], rasterized=True,
    )  # fmt: skip
    bar = figure.colorbar(mesh, ax=axis, shrink=0.8, pad=0.02)
    bar.ax.tick_params(labelsize=7)


def write_maps(
    measurement: Measurement,
    reference: ImageLike,
    path: PathLike,
    *,
    title: str | None = None,
    correction: Correction | None = None,
) -> None:
    """Write one picture with five maps of a measurement: two displacements and three strains.

    Parameters
    ----------
    measurement : Measurement
    reference : ndarray, shape (height, width), or path
        The reference image, in which the points are defined.
    path : path
        The file to write. The suffix of the file name determines the image format.
    title : str, optional
        Title of the picture. Default: the measurement's label.
    correction : Correction, optional
        Correction of the measurement. If the image was corrected, the maps show corrected values instead of
        calibrated ones.
    """
    require_kind("measurement", measurement, Measurement, MEASURE_FIRST)
    grey = grey_image(reference, "reference image")
    title = measurement.label if title is None else title
    write_figure(draw_maps(measurement, grey, title, correction), path, dpi=110)
