"""The declared criterion of plastic deformation, which ends the increments of load."""

from collections.abc import Sequence

from pydantic import Field

from drivers.settings import Settings
from rig.errors import ProtocolError


class PlasticCriterion(Settings):
    """Plastic deformation is evident when an increment is clearly softer than the stiffest one before it.

    The stiffness of an increment is ΔF/Δu between two settled steps, u being the displacement of the grips.
    Grips that seat and slip make the first increments soft, so each increment is compared with the *stiffest*
    one so far and not with the first. Slip can also soften a later increment; `judged_above_n` is the load up
    to which slip is expected: increments commanded to this load or less are not judged.
    """

    stiffness_fraction: float = Field(
        gt=0.0, lt=1.0, description="plastic below this fraction of the stiffest"
    )
    judged_above_n: float = Field(ge=0.0, description="increments to this load or less are not judged")

    def is_evident(self, loads_n: Sequence[float], displacements_mm: Sequence[float]) -> bool:
        """Judge the last increment.

        Parameters
        ----------
        loads_n, displacements_mm : sequence of float, length k + 1
            Settled load in N and displacement in mm at the reference and after each of k >= 1 increments.

        Raises
        ------
        ProtocolError
            If the grips did not move apart during an increment, so that its stiffness means nothing.
        """
        stiffnesses = [
            _stiffness_n_mm(loads_n[i - 1 : i + 1], displacements_mm[i - 1 : i + 1])
            for i in range(1, len(loads_n))
        ]
        return stiffnesses[-1] < self.stiffness_fraction * max(stiffnesses)


def _stiffness_n_mm(loads_n: Sequence[float], displacements_mm: Sequence[float]) -> float:
    advance_mm = displacements_mm[1] - displacements_mm[0]
    if advance_mm <= 0.0:
        raise ProtocolError(
            f"increment from {loads_n[0]:.0f} N to {loads_n[1]:.0f} N",
            "the grips to move apart as the load rises",
            f"{advance_mm:+.4f} mm",
            "check the displacement transducer of the load frame",
        )
    return (loads_n[1] - loads_n[0]) / advance_mm
