"""The limits that a protocol declares, checked at every reading of the load frame."""

from rig.errors import LimitViolation, SpecimenBroken
from rig.protocol.protocol import Limits
from rig.protocol.step import Reading


class Watch:
    """Remembers the highest load and judges each reading against the declared limits.

    Parameters
    ----------
    limits : Limits
    carried_n : float
        A break is judged only once the specimen has carried this load: below it the grips still seat.
    """

    def __init__(self, limits: Limits, carried_n: float) -> None:
        self._limits = limits
        self._carried_n = carried_n
        self._highest_n = 0.0

    def check(self, reading: Reading, step: str) -> None:
        """Judge one reading.

        Raises
        ------
        LimitViolation
            If load or displacement is beyond its limit, in either direction.
        SpecimenBroken
            If the load fell by more than the declared fraction of the highest one.
        """
        limits = self._limits
        values = (
            (reading.load_n, limits.load_max_n, "load", "N"),
            (reading.displacement_mm, limits.displacement_max_mm, "displacement", "mm"),
        )
        for value, limit, name, unit in values:
            # `not <=` instead of `>`, so that NaN is refused too.
            if not abs(value) <= limit:
                raise LimitViolation(
                    step,
                    f"a {name} within {limit:g} {unit}",
                    f"{value:.6g} {unit}",
                    "look at the specimen before anything moves again; only if it is sound, raise "
                    f"limits.{name}_max_{unit.lower()} above {limit:g}",
                )
        self._highest_n = max(self._highest_n, reading.load_n)
        lowest_n = (1.0 - limits.break_load_drop) * self._highest_n
        if self._highest_n >= self._carried_n and reading.load_n < lowest_n:
            raise SpecimenBroken(
                step,
                f"a load above {lowest_n:.0f} N after {self._highest_n:.0f} N",
                f"{reading.load_n:.0f} N",
                "the specimen broke or slipped out of the grips: the images up to here are on file; "
                f"if it did neither, raise limits.break_load_drop above {limits.break_load_drop:g}",
            )
