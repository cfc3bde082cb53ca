"""The values of a field at the pixels of a panel, interpolated between its points, and their colours."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dic.pictures.page import Frame
from dic.typing import Float, Mask

_REACH = 0.75
"""Largest distance of a pixel from the nearest point, in steps of the grid. A pixel further away lies in a
crack that has opened, beyond which another point would wrongly seem near.
"""
_MOVES = 3
_LARGEST = 1e4


@dataclass(frozen=True)
class Sampling:
    """Where each pixel of a panel lies among the points of a field."""

    columns: NDArray[np.float32]
    rows: NDArray[np.float32]
    """Index of the point at each pixel, with fractions between points."""
    inside: NDArray[np.float32]
    """1 at pixels in the cells of points, 0 at others; between them at the edge of the field."""
    px_per_point: float
    """Distance of neighbouring points, px."""

    @classmethod
    def of(cls, cells: Float, known: Mask, size: tuple[int, int]) -> "Sampling | None":
        """Return where pixels lie among points, by the cell of the nearest known point; None without points.

        `cells`, shape (rows + 1, columns + 1, 2): corners of the cells around the points, px from the upper
        left corner of the panel. `known`, shape (rows, columns): True for points with a value. `size`: width
        and height of the panel, px.
        """
        import cv2

        centre = (cells[:-1, :-1] + cells[:-1, 1:] + cells[1:, :-1] + cells[1:, 1:]) / 4
        right = (cells[:-1, 1:] - cells[:-1, :-1] + cells[1:, 1:] - cells[1:, :-1]) / 2
        down = (cells[1:, :-1] - cells[:-1, :-1] + cells[1:, 1:] - cells[:-1, 1:]) / 2
        area = right[..., 0] * down[..., 1] - right[..., 1] * down[..., 0]
        width, height = size
        place = np.floor(centre)
        shown = (place >= 0).all(axis=-1) & (place < (width, height)).all(axis=-1)
        usable = known & (area != 0.0)
        row, column = np.nonzero(usable & shown)
        if not row.size:
            return None
        x, y = place[row, column].astype(int).T
        seeds = np.ones((height, width), np.uint8)
        seeds[y, x] = 0
        _, labels = cv2.distanceTransformWithLabels(seeds, cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL)
        nearest = np.zeros(int(labels.max()) + 1, np.int32)
        nearest[labels[y, x]] = row * known.shape[1] + column
        # The inverse of the matrix with the columns `right` and `down` takes px to steps of the grid.
        with np.errstate(divide="ignore", invalid="ignore"):
            inverse = np.stack([down[..., 1], -down[..., 0], -right[..., 1], right[..., 0]]) / area
        cell = [*np.moveaxis(centre, -1, 0), *inverse]
        flat = [np.ascontiguousarray(each, np.float32).ravel() for each in cell]
        at_x, at_y = (np.arange(length, dtype=np.float32) + np.float32(0.5) for length in size)
        point = nearest[labels]
        columns, rows = _places(point, at_x, at_y[:, None], flat, known.shape[1])
        for _ in range(_MOVES):
            # Where cells differ in size, a pixel may lie beside the cell of the nearest point.
            there = np.rint(rows.clip(0, known.shape[0] - 1)), np.rint(columns.clip(0, known.shape[1] - 1))
            other = (there[0] * known.shape[1] + there[1]).astype(np.int32)
            wrong = np.nonzero((other != point) & usable.ravel()[other])
            if not wrong[0].size:
                break
            point[wrong] = other[wrong]
            x_px, y_px = at_x[wrong[1]], at_y[wrong[0]]
            columns[wrong], rows[wrong] = _places(point[wrong], x_px, y_px, flat, known.shape[1])
        side = float(np.sqrt(np.median(np.abs(area[row, column]))))
        edge = np.minimum(
            np.minimum(columns, known.shape[1] - 1 - columns), np.minimum(rows, known.shape[0] - 1 - rows)
        )
        away_columns, away_rows = columns - point % known.shape[1], rows - point // known.shape[1]
        far = np.maximum(np.abs(away_columns), np.abs(away_rows)) > _REACH
        inside_px = np.where(far, np.float32(0.0), ((edge + 0.5) * side + 0.5).clip(0.0, 1.0))
        return cls(columns, rows, inside_px.astype(np.float32), side)

    def painted(
        self, values: Float, ends: tuple[float, float], table: NDArray[np.uint8], opacity: float, grey: Frame
    ) -> Frame:
        """Return the colours of a field over a picture of the panel's size.

        Values are interpolated between neighbouring points that have one. The cells of points without a value
        stay empty: a pixel has a colour if most of the interpolation's weight is on points with a value.

        `values`, shape (rows, columns): NaN at a point without a value. `ends`: values of the first and the
        last colour of the table.
        """
        import cv2

        known = np.isfinite(values)
        with np.errstate(over="ignore"):
            level = (np.where(known, values, 0.0) - ends[0]) * (255.0 / (ends[1] - ends[0]))
        weighted = np.where(known, level.clip(-_LARGEST, _LARGEST), 0.0).astype(np.float32)
        total, weight = self._interpolated(weighted), self._interpolated(known.astype(np.float32))
        level = np.divide(total, weight, out=np.zeros_like(total), where=weight > 0.0)
        colours = cv2.applyColorMap(np.rint(level.clip(0.0, 255.0)).astype(np.uint8), table[:, None])
        # The edge is as wide as a pixel, so it is smooth and looks sharp.
        share = ((weight - 0.5) * max(1.0, self.px_per_point) + 0.5).clip(0.0, 1.0)
        share *= np.float32(opacity) * self.inside
        return np.asarray(cv2.blendLinear(colours, grey, share, 1.0 - share))

    def _interpolated(self, values: NDArray[np.float32]) -> NDArray[Any]:
        import cv2

        columns, rows = self.columns, self.rows
        if self.px_per_point < 1.0:
            # More points than pixels are averaged first, or single points would stand for all around them.
            height, width = values.shape
            size = (max(1, round(width * self.px_per_point)), max(1, round(height * self.px_per_point)))
            values = np.asarray(cv2.resize(values, size, interpolation=cv2.INTER_AREA), np.float32)
            columns = (columns + 0.5) * np.float32(size[0] / width) - np.float32(0.5)
            rows = (rows + 0.5) * np.float32(size[1] / height) - np.float32(0.5)
        return np.asarray(cv2.remap(values, columns, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE))


def _places(
    point: NDArray[np.int32], x: Any, y: Any, cells: list[NDArray[np.float32]], width: int
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return column and row of pixels at (x, y) px among the points, by the cells of given points."""
    middle_x, middle_y, column_x, column_y, row_x, row_y = (each[point] for each in cells)
    away_x, away_y = x - middle_x, y - middle_y
    columns = column_x * away_x + column_y * away_y + point % width
    rows = row_x * away_x + row_y * away_y + point // width
    return columns.astype(np.float32), rows.astype(np.float32)
