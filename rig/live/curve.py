"""The curves of a running test as people see them: some hundred points for each gauge."""

import math

_POINTS = 400


class Curves:
    """Collects points of strain and stress, and thins them out as they become many.

    `area_mm2` is the cross section of the specimen; with NaN the points have loads.
    """

    def __init__(self, area_mm2: float) -> None:
        self.unit = "N" if math.isnan(area_mm2) else "MPa"
        self._scale = 1.0 if math.isnan(area_mm2) else 1.0 / area_mm2
        self._points: dict[str, list[tuple[float, float]]] = {}
        self._every: dict[str, int] = {}
        self._count: dict[str, int] = {}

    def add(self, gauge: str, strain: float, load_n: float) -> None:
        """Add a point to the curve of a gauge."""
        points = self._points.setdefault(gauge, [])
        every, count = self._every.get(gauge, 1), self._count.get(gauge, 0)
        self._count[gauge] = count + 1
        if count % every:
            return
        points.append((strain, self._scale * load_n))
        if len(points) >= _POINTS:
            # Keep every second point, from now on also of the later ones.
            del points[1::2]
            self._every[gauge] = 2 * every

    @property
    def points(self) -> dict[str, list[tuple[float, float]]]:
        """The points of each gauge: strain, and stress in MPa or load in N. The newest may be missing."""
        return {gauge: list(points) for gauge, points in self._points.items()}
