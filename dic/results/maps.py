"""Maps of displacement and strain, drawn over the reference image."""

from dataclasses import dataclass
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

_MAPS = 5
_TITLE_IN = 0.32
_MARGIN_IN = 0.06
_BAR_WIDTH_IN = 0.14
_BAR_ROOM_IN = 0.8  # for a colour bar with its labels
_FINE_PX = 800
_LEAST_SPREAD = 1e-3
"""Least range of a colour scale, as a part of the values."""

_Box = tuple[float, float, float, float]


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
    cells = _Cells.of(height / width, bool(title))
    figure = Figure(figsize=(cells.columns * cells.width_in, cells.figure_height_in))
    figure.suptitle(title, va="center", y=1.0 - 0.5 * _TITLE_IN / cells.figure_height_in)
    low, high = np.percentile(image, (1, 99.5))
    background, extent = _of_few_pixels(image), (-0.5, width - 0.5, height - 0.5, -0.5)
    for number, (name, values) in enumerate(panels(measurement, correction)):
        map_box, bar_box = cells.boxes(number)
        axis = figure.add_axes(map_box)
        axis.imshow(background, cmap="gray", vmin=low, vmax=high, extent=extent, aspect="auto")
        mesh = _overlay(axis, measurement, values)
        bar = figure.colorbar(mesh, cax=figure.add_axes(bar_box))
        bar.ax.tick_params(labelsize=7)
        bar.ax.ticklabel_format(useOffset=False)
        # With a given height, matplotlib does not measure the labels to find a height.
        axis.set_title(name, loc="left", fontsize=9, y=1.0)
        axis.set_axis_off()
    return figure


@dataclass(frozen=True)
class _Cells:
    """Equal cells for the maps, row by row, each with a title above its map and a colour bar beside it.

    The sizes are fixed, because matplotlib's layout engines need longer to find room for the labels than
    matplotlib needs to draw the figure.
    """

    columns: int
    width_in: float
    map_in: tuple[float, float]  # width, height
    figure_height_in: float

    @classmethod
    def of(cls, aspect: float, titled: bool) -> "_Cells":
        """Return the cells for images whose height is `aspect` times their width."""
        columns, width_in = (5, 3.0) if aspect >= 1.0 else (3, 4.2)
        map_width_in = width_in - _BAR_ROOM_IN - _MARGIN_IN
        map_in = map_width_in, map_width_in * aspect
        rows_in = -(-_MAPS // columns) * (map_in[1] + _TITLE_IN)
        height_in = rows_in + _MARGIN_IN + (_TITLE_IN if titled else 0.0)
        return cls(columns, width_in, map_in, height_in)

    def boxes(self, number: int) -> tuple[_Box, _Box]:
        """Return the places of a map and of its colour bar as matplotlib's fractions of the figure."""
        row, column = divmod(number, self.columns)
        rows_below = -(-_MAPS // self.columns) - 1 - row
        map_width_in, height_in = self.map_in
        left_in = column * self.width_in + _MARGIN_IN
        bottom_in = rows_below * (height_in + _TITLE_IN) + _MARGIN_IN
        bar_left_in = left_in + map_width_in + _MARGIN_IN

        def box(left_in: float, width_in: float) -> _Box:
            across, up = self.columns * self.width_in, self.figure_height_in
            return left_in / across, bottom_in / up, width_in / across, height_in / up

        return box(left_in, map_width_in), box(bar_left_in, _BAR_WIDTH_IN)


def _of_few_pixels(image: NDArray[Any]) -> NDArray[Any]:
    """Return the image with at most `_FINE_PX` columns; a map in the figure has fewer."""
    import cv2

    scale = _FINE_PX / image.shape[1]
    if scale >= 1.0:
        return image
    return np.asarray(cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA))


def _overlay(axis: Any, measurement: Measurement, values: Float) -> Any:
    field = measurement.field
    known = values[np.isfinite(values)]
    low, high = np.percentile(known, (1, 99)) if known.size else (0.0, 1.0)
    # A uniform field differs by rounding errors only, which a scale must not show.
    spread = _LEAST_SPREAD * max(abs(low), abs(high))
    if high - low < spread:
        low, high = low - spread / 2, high + spread / 2
    return axis.pcolormesh(
        field.x_px, field.y_px, values, shading="nearest", cmap="turbo", alpha=0.75,
        vmin=low, vmax=high, rasterized=True,
    )  # fmt: skip


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
