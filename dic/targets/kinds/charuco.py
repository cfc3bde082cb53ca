"""ChArUco boards: checkerboards with markers."""

from dataclasses import dataclass, field
from itertools import product

import numpy as np

from dic.errors import Check
from dic.keywords import named_settings
from dic.targets.charuco import find_charuco, is_dictionary, nearest_dictionary
from dic.targets.kinds.checkerboard import CheckerboardTarget
from dic.targets.kinds.target import Hints, SeenTarget
from dic.targets.points import GridPoints
from dic.targets.sheet.shapes import Shapes
from dic.typing import Grey


@named_settings
@dataclass(frozen=True)
class CharucoTarget(CheckerboardTarget):
    """A checkerboard with ArUco markers in its bright squares, as OpenCV draws it.

    The Y axis points to the top edge of the board as drawn.

    Attributes
    ----------
    squares : tuple of int
        Number of squares along X and along Y.
    pitch_mm, marker_mm : float
        Lengths of the side of a square and of the side of a marker.
    dictionary : str
        Name of OpenCV's dictionary of markers, such as ``"DICT_5X5_100"``.
    """

    name = "charuco"
    title = "a ChArUco board"
    printed = (
        "ChArUco board, {x} × {y} squares of {pitch_mm:g} mm, markers of {marker_mm:g} mm, {dictionary}."
    )
    fewest = 3

    marker_mm: float = field(
        metadata={"help": "Side of a ChArUco board's markers.", "in_pitches": 0.75},
    )
    dictionary: str = field(
        default="DICT_5X5_100",
        metadata={"help": "OpenCV's name for the dictionary of a ChArUco board's markers."},
    )

    def find(self, grey: Grey, source: str, hints: Hints) -> GridPoints:
        """Return the visible corners."""
        side = self.marker_mm / self.pitch_mm
        return find_charuco(grey, self.squares, self.pitch_mm, side, self.dictionary, source)

    def is_shown_as(self, seen: SeenTarget) -> bool:
        """Return True for a board of these squares with markers of the same family."""
        family = seen.dictionary.rpartition("_")[0]
        return bool(family) and self.dictionary.startswith(family) and seen.counts == tuple(self.squares)

    def _checks(self) -> list[Check]:
        return [
            self._enough(),
            (
                not self._pitch_is_possible or 0 < self.marker_mm < self.pitch_mm,
                "side of a marker",
                f"between 0 and the pitch, {self.pitch_mm:g} mm",
                f"{self.marker_mm:g} mm",
                f"give --marker-mm {0.7 * self.pitch_mm:g}",
            ),
            (
                is_dictionary(self.dictionary),
                "dictionary",
                "a dictionary of OpenCV",
                self.dictionary,
                f"give --dictionary {nearest_dictionary(self.dictionary)}",
            ),
        ]

    def shapes(self) -> Shapes:
        """Return the dark squares, and the dark modules of the markers, row by row."""
        import cv2

        columns, rows = self.squares
        pitch, side = self.pitch_mm, self.marker_mm
        dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, self.dictionary))
        board = cv2.aruco.CharucoBoard(self.squares, pitch, side, dictionary)
        # A marker has a dark border around its bits, one module wide.
        modules = dictionary.markerSize + 2
        step = side / modules
        bright: set[tuple[int, int]] = set()
        cells: list[tuple[float, ...]] = []
        corners = np.asarray(board.getObjPoints(), np.float64)[:, 0, :2]
        for number, corner in zip(np.ravel(board.getIds()), corners, strict=True):
            left, top = corner[0] - columns * pitch / 2, rows * pitch / 2 - corner[1]
            bright.add((int(corner[0] / pitch), int(corner[1] / pitch)))
            dark = np.asarray(cv2.aruco.generateImageMarker(dictionary, int(number), modules)) < 128
            for row, across in zip(*np.nonzero(dark), strict=True):
                cells.append((left + across * step, top - (row + 1) * step, step, step))
        cells += [
            ((column - columns / 2) * pitch, (rows / 2 - row - 1) * pitch, pitch, pitch)
            for column, row in product(range(columns), range(rows))
            if (column, row) not in bright
        ]
        return Shapes(rectangles=np.array(cells))
