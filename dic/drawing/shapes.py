"""Converts existing regions and gauges to the shapes that a page shows at first."""

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np

from dic.calibration.calibration import Calibration
from dic.errors import all_of
from dic.gauges.declared import Gauge
from dic.gauges.file import gauge_text
from dic.image.given import checked_region
from dic.pictures.places import mapped
from dic.regions.drawn import DrawnRegion
from dic.regions.read import is_region_file, read_drawn_region
from dic.specimen.write import region_polygons
from dic.typing import Float, Mask, PathLike

Shape = dict[str, Any]

_TOLERANCE_PX = 1.5
"""Largest distance of polygons from the outline of a mask. A finer outline has too many corners to move."""


def region_shapes(region: Mask | PathLike, image_shape: tuple[int, ...]) -> list[Shape]:
    """Return the polygons, holes and cracks of a region as shapes.

    `region`, shape (height, width): a mask, or the path of a mask image or of a region file. A mask gives
    polygons that follow its outline within 1.5 px. `image_shape`: height and width of the image, px.

    Raises `MeasurementError` if the region cannot be read, or does not fit the image.
    """
    if isinstance(region, np.ndarray) or not is_region_file(region):
        mask = checked_region(region, image_shape)
        return _outline_shapes(region_polygons(mask, _TOLERANCE_PX))
    drawn = read_drawn_region(str(region))
    drawn.require_fits(image_shape)
    return _drawn_shapes(drawn)


def _outline_shapes(polygons: Sequence[Float]) -> list[Shape]:
    """Return the outlines of a mask as polygons, and the outlines of its holes as holes.

    If a hole has a part of the region inside, its outline is returned as a polygon. As a hole it would also
    leave out that part.
    """
    import cv2

    def inside(corners: Float, outer: Float) -> bool:
        x, y = corners[0].tolist()
        return cv2.pointPolygonTest(outer.astype(np.float32), (x, y), False) > 0

    within = np.array([[one is not other and inside(one, other) for other in polygons] for one in polygons])
    is_hole = (within.sum(axis=1) == 1) & ~within.any(axis=0)
    return [
        _shape("hole" if hole else "region", corners) for corners, hole in zip(polygons, is_hole, strict=True)
    ]


def _drawn_shapes(drawn: DrawnRegion) -> list[Shape]:
    return [
        *(_shape("region", one.corners) for one in drawn.polygons),
        *(_shape("hole", one.corners) for one in drawn.holes),
        *(_shape("crack", one.path, width_px=one.width_px) for one in drawn.cracks),
    ]


def gauge_shapes(gauges: Sequence[Gauge], image_shape: tuple[int, ...]) -> list[Shape]:
    """Return the gauges in px as shapes; gauges in mm are left out.

    `image_shape`: height and width of the image, px.

    Raises `GaugeError` if a gauge lies outside the image. The message names all such gauges together.
    """
    all_of(*(partial(gauge.require_inside, image_shape) for gauge in gauges))
    return [_gauge_shape(gauge) for gauge in gauges if gauge.unit == "px"]


def kept_gauges(gauges: Sequence[Gauge], calibration: Calibration | None) -> list[dict[str, Any]]:
    """Return the gauges in mm as data for the page, which shows and saves them but does not change them.

    The lines of these gauges are drawn with the homography that fits the grid points. The homography is exact
    only for a lens without distortion, so the drawn lines are only for orientation.
    """
    found = []
    homography = None if calibration is None else _to_px(calibration)
    for gauge in gauges:
        if gauge.unit == "px":
            continue
        lines = [] if homography is None else [mapped(homography, line) for line in gauge.drawn_lines()]
        note = "saved without a change" if lines else "not shown without --calibration"
        shown = [np.round(line, 1).tolist() for line in lines]
        found.append(
            {"name": gauge.name, "kind": gauge.kind, "lines": shown, "text": gauge_text(gauge), "note": note}
        )
    return found


def _gauge_shape(gauge: Gauge) -> Shape:
    kind, places, values = gauge.drawn_shape()
    return _shape(kind, places, gauge.name, **values)


def _shape(kind: str, points: Any, name: str = "", **values: float | None) -> Shape:
    return {"kind": kind, "name": name, "points": np.asarray(points, np.float64).tolist(), "values": values}


def _to_px(calibration: Calibration) -> Float:
    """Return the homography from millimetres to image pixels that fits the grid points."""
    import cv2

    found, _ = cv2.findHomography(calibration.grid.xy_mm, calibration.grid.uv_px)
    return np.asarray(found, np.float64)
