"""The lists of values from which a study makes its combinations of settings."""

from dataclasses import dataclass
from functools import partial

from dic.correlation.settings import SHAPES, CorrelationSettings
from dic.errors import Check, CorrelationError, all_of, is_whole, require_all
from dic.strain.settings import StrainSettings

_MOST = 2000
"""Largest number of combinations, so that a typing error does not start a study of days."""
_MOST_PARTS = 64


@dataclass(frozen=True)
class Sweep:
    """Lists of values for four settings; a study compares all combinations of these values.

    Attributes
    ----------
    subsets_px, steps_px, windows_points : tuple of int
        Widths of the subsets, spacings of the points, and widths of the strain windows. Most of the default
        widths are one column narrower than a multiple of 8, which the processor computes together.
    shapes : tuple of str
        Shape functions, "affine" and "quadratic".
    parts : int
        Largest number of parts of the region on which the combinations are tried.

    Raises
    ------
    CorrelationError
        If a value is not allowed, or if there is no combination or too many.
    """

    subsets_px: tuple[int, ...] = (15, 23, 31, 39, 41, 47, 63, 79)
    steps_px: tuple[int, ...] = (5, 10, 15)
    windows_points: tuple[int, ...] = (3, 5, 7, 9)
    shapes: tuple[str, ...] = tuple(SHAPES)
    parts: int = 4

    def __post_init__(self) -> None:
        checks: list[Check] = [
            (
                isinstance(values, tuple) and 0 < len(values) == len(set(values)),
                name,
                "one value or several different ones",
                values,
                f"give for example {example}",
            )
            for name, values, example in (
                ("subsets", self.subsets_px, "21,31,41"),
                ("steps", self.steps_px, "5,10"),
                ("strain windows", self.windows_points, "3,5,7"),
                ("shape functions", self.shapes, "affine,quadratic"),
            )
        ]
        whole = is_whole(self.parts) and 1 <= self.parts <= _MOST_PARTS
        checks.append((whole, "parts", f"a whole number from 1 to {_MOST_PARTS}", self.parts, "give 4 parts"))
        require_all(CorrelationError, "settings", checks)
        all_of(
            *(partial(CorrelationSettings, subset_px=value) for value in self.subsets_px),
            *(partial(CorrelationSettings, step_px=value) for value in self.steps_px),
            *(partial(CorrelationSettings, shape=value) for value in self.shapes),
            *(partial(StrainSettings, window_points=value) for value in self.windows_points),
        )
        if self.combinations > _MOST:
            remedy = "give fewer subsets, steps or windows"
            raise CorrelationError(
                "settings", "combinations", f"at most {_MOST}", f"{self.combinations}", remedy
            )

    @property
    def combinations(self) -> int:
        """Number of combinations of settings."""
        return len(self.shapes) * len(self.subsets_px) * len(self.steps_px) * len(self.windows_points)

    def measured_with(self, step_px: int) -> int:
        """Return the smallest step of the sweep that divides `step_px`; points are correlated at this step.

        The points of the step `step_px` are then a part of these points, so they need no further correlation.
        """
        return min(step for step in self.steps_px if step_px % step == 0)

    @property
    def trials(self) -> int:
        """Number of combinations that are correlated."""
        return len(self.shapes) * len(self.subsets_px) * len(self.measured_steps_px)

    @property
    def measured_steps_px(self) -> tuple[int, ...]:
        """The steps at which points are correlated; see `measured_with`."""
        return tuple(sorted({self.measured_with(step) for step in self.steps_px}))
