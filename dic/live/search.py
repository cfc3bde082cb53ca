"""Searches lost points: one point in each frame, by comparison of whole pixels."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from dic.correlation.prepared_reference import PreparedReference
from dic.image.stored import StoredImage
from dic.live.tracking import Tracker
from dic.typing import Float, Grey

_LEAST_RADIUS_PX = 15
_LEAST_SCORE = 0.5


class LostPoints:
    """Search for tiles without any point that has a displacement.

    `reference`: the prepared reference. `image`: the reference image. `search_px`: distance within which a
    point is searched around its expected place.
    """

    def __init__(
        self, reference: PreparedReference, image: StoredImage, tracker: Tracker, search_px: int
    ) -> None:
        self._tracker, self._search_px, self._turn = tracker, search_px, 0
        radius = max(reference.settings.radius_px, _LEAST_RADIUS_PX)
        points, numbers = tracker.points, tracker.points.points
        self._templates: list[list[tuple[int, tuple[int, int], Grey]]] = []
        for tile in range(len(points.tiles)):
            own = []
            for number in tracker.probes(tile).tolist():
                x, y = int(points.x[numbers[number]]), int(points.y[numbers[number]])
                top, left = max(0, y - radius), max(0, x - radius)
                grey = image.part(slice(top, y + radius + 1), slice(left, x + radius + 1))
                own.append((number, (x - left, y - top), grey))
            self._templates.append(own)

    def search(self, image: NDArray[Any]) -> int:
        """Search one point of one lost tile in a frame; return the number of lost tiles."""
        lost = self._tracker.lost_tiles
        if len(lost) and self._search_px:
            tile = int(lost[self._turn % len(lost)])
            probes = self._templates[tile]
            number, middle, template = probes[(self._turn // len(lost)) % len(probes)]
            self._turn += 1
            warp = self._found(image, number, middle, template)
            if warp is not None:
                self._tracker.place_tile(tile, number, warp)
        return len(lost)

    def _found(
        self, image: NDArray[Any], number: int, middle: tuple[int, int], template: Grey
    ) -> Float | None:
        """Return the warp (6,) at which a frame shows the template best; None if it does not show it."""
        import cv2

        points = self._tracker.points
        node, (right, down) = points.points[number], middle
        warp: Float = self._tracker.warps[node, :6].copy()
        # The place of the template's first pixel.
        x = round(float(points.x[node] + warp[0])) - right
        y = round(float(points.y[node] + warp[3])) - down
        height, width = template.shape
        top, left = max(0, y - self._search_px), max(0, x - self._search_px)
        window = image[top : max(0, y + height + self._search_px), left : max(0, x + width + self._search_px)]
        if window.shape[0] < height or window.shape[1] < width:
            return None
        grey = np.ascontiguousarray(window, np.float32)
        if np.ptp(grey) == 0.0 or np.ptp(template) == 0.0:
            return None
        _, score, _, (column, row) = cv2.minMaxLoc(cv2.matchTemplate(grey, template, cv2.TM_CCOEFF_NORMED))
        if score < _LEAST_SCORE:
            return None
        warp[0] = left + column + right - points.x[node]
        warp[3] = top + row + down - points.y[node]
        return warp
