"""The values of a field at the pixels of a panel, interpolated between its points, and their colours."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dic.pictures.cells import Cells
from dic.pictures.marks import Frame
from dic.typing import Float, Mask

_LARGEST = 1e4
"""Largest level of a colour that is interpolated; the table has the levels 0 to 255."""


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
    def of(cls, corners: Float, known: Mask, size: tuple[int, int]) -> "Sampling | None":
        """Return where pixels lie among points; None if no point is shown.

        `corners`, shape (rows + 1, columns + 1, 2): corners of the cells around the points, px from the upper
        left corner of the panel. `known`, shape (rows, columns): True for points with a value. `size`: width
        and height of the panel, px.
        """
        cells = Cells(corners, known)
        found = cells.at_pixels(size)
        if found is None:
            return None
        columns, rows, near = found
        last_row, last_column = known.shape[0] - 1, known.shape[1] - 1
        edge = np.minimum(np.minimum(columns, last_column - columns), np.minimum(rows, last_row - rows))
        inside = np.where(near, ((edge + 0.5) * cells.side_px + 0.5).clip(0.0, 1.0), 0.0)
        return cls(columns, rows, inside.astype(np.float32), cells.side_px)

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
