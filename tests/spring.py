"""A spring as load string, for tests in which the specimen need not yield."""

import math

STIFFNESS_N_MM = 5000.0


class Spring:
    """A linear load string; its load cell can be broken."""

    broken_cell = False

    def stretch_to(self, displacement_mm: float) -> float:
        return math.nan if self.broken_cell else STIFFNESS_N_MM * displacement_mm

    def break_now(self) -> None: ...
