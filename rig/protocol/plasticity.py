"""The criterion for plastic deformation, which ends the increments of load."""

from collections.abc import Sequence

from pydantic import Field

from drivers.settings import Settings
from rig.errors import ProtocolError
from rig.protocol.step import ProtocolStep, RigReading


class PlasticCriterion(Settings):
    """Plastic deformation is evident if a load increment is clearly softer than the stiffest increment.

    The stiffness of an increment is the change of load ΔF divided by the change of grip displacement Δu
    between two settled steps. The first increments can have a low stiffness, because the grips settle and
    slip. Therefore each increment is compared with the *stiffest* increment so far and not with the first
    increment. Slip can also reduce the stiffness of a later increment. `judged_above_n` is the load up to
    which slip is expected. Increments to this load or less are not judged.
    """

    stiffness_fraction: float = Field(
        gt=0.0, lt=1.0, description="an increment is plastic below this fraction of the highest stiffness"
    )
    judged_above_n: float = Field(ge=0.0, description="increments to this load or less are not judged")

    def is_evident(self, loads_n: Sequence[float], displacements_mm: Sequence[float]) -> bool:
        """Return True if the last increment shows plastic deformation.

        `loads_n` and `displacements_mm` are the settled loads in N and displacements in mm at the reference
        and after each of k >= 1 increments, in tension or in compression. Raise `ProtocolError` if the grips
        did not move in the direction of the load during an increment, because its stiffness is then
        undefined.
        """
        sense = -1.0 if loads_n[-1] < loads_n[0] else 1.0
        stiffnesses = [
            _stiffness_n_mm(loads_n[i - 1 : i + 1], displacements_mm[i - 1 : i + 1], sense)
            for i in range(1, len(loads_n))
        ]
        return stiffnesses[-1] < self.stiffness_fraction * max(stiffnesses)

    def can_end(self, number: int, step: ProtocolStep) -> bool:
        """Return True from the second increment on, at loads above `judged_above_n`."""
        # Compare the commanded load with `judged_above_n`, because the measured load has noise.
        return number >= 2 and abs(step.target) > self.judged_above_n

    def is_met(self, readings: Sequence[RigReading]) -> bool:
        """Return True if the last load increment is clearly less stiff than the stiffest increment so far."""
        return self.is_evident([r.load_n for r in readings], [r.displacement_mm for r in readings])

    def at_readings(self) -> None:
        """Return None, because the stiffness of an increment is not known before its end."""

    def describe(self) -> str:
        """Return a description of this criterion for an error message."""
        return f"an increment of less than {self.stiffness_fraction:g} of the highest stiffness"

    def first_judged_n(self, increment_n: float) -> float:
        """Return the load of the first increment that can show plastic deformation."""
        return max(2, int(self.judged_above_n // increment_n) + 1) * increment_n


def _stiffness_n_mm(loads_n: Sequence[float], displacements_mm: Sequence[float], sense: float) -> float:
    advance_mm = displacements_mm[1] - displacements_mm[0]
    if sense * advance_mm <= 0.0:
        way = "apart as the load rises" if sense > 0.0 else "together as the compressive load rises"
        raise ProtocolError(
            f"increment from {loads_n[0]:.0f} N to {loads_n[1]:.0f} N",
            f"the grips to move {way}",
            f"{advance_mm:+.4f} mm",
            "check the displacement transducer of the load frame",
        )
    return (loads_n[1] - loads_n[0]) / advance_mm
