"""What `dic correlate` does with calibrated images whose motion is known: corrections, as images come in."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from dic.shell.console import say

if TYPE_CHECKING:
    from dic.calibration.calibration import Calibration
    from dic.out_of_plane.alignment import Alignment
    from dic.out_of_plane.correction import Correction
    from dic.strain.measurement import Measurement


class CorrectedSeries:
    """Corrects the images of a series, in tension each at once, in a rotation all at the end.

    Parameters
    ----------
    motion : str
        "free", "rigid" or "tension".
    calibration : Calibration or None
        Without one nothing can be corrected.
    poisson_ratio : float
        Of the specimen.
    alignment : Alignment or None
        Solved before on the same fixture.

    Raises
    ------
    CorrelationError
        If these do not go together.
    """

    def __init__(
        self,
        motion: str,
        calibration: "Calibration | None",
        poisson_ratio: float,
        alignment: "Alignment | None",
    ) -> None:
        _require_sense(motion, calibration, poisson_ratio, alignment)
        self._motion, self._calibration = motion, calibration
        self._poisson_ratio, self._alignment = poisson_ratio, alignment
        self._waiting: list[tuple[dict[str, Any], Measurement]] = []
        self.corrections: list[Correction] = []

    def add(self, summary: dict[str, Any], measurement: "Measurement") -> None:
        """Take one more image; `summary` gets its correction, now or at the end."""
        if self._calibration is None:
            return
        if self._motion == "rigid":
            self._waiting.append((summary, measurement))
        else:
            self._correct([(summary, measurement)])

    def finish(self) -> dict[str, Any]:
        """Correct what waits for the last image; return what is said of the set-up, JSON-ready."""
        from dic.out_of_plane.diagnosis import Sensitivity, alignment_as_dict

        if self._calibration is None:
            return {}
        if self._waiting:
            self._correct(self._waiting)
            for summary, _ in self._waiting:
                say(f"{Path(summary['file']).name}: {corrected_text(summary['corrected'])}")
        sensitivity = Sensitivity.of(self._calibration)
        return {
            "motion": self._motion,
            "alignment": None if self._alignment is None else alignment_as_dict(self._alignment),
            "sensitivity": None if sensitivity is None else vars(sensitivity),
        }

    @property
    def alignment(self) -> "Alignment | None":
        """The alignment in use, after `finish` the solved one."""
        return self._alignment

    def _correct(self, images: "list[tuple[dict[str, Any], Measurement]]") -> None:
        from dic.out_of_plane.correct import correct

        if self._calibration is None:
            return
        found = correct(
            self._motion,
            [measurement for _, measurement in images],
            self._calibration,
            poisson_ratio=self._poisson_ratio,
            alignment=self._alignment,
        )
        self._alignment = found.alignment or self._alignment
        self.corrections += found.images
        for (summary, _), correction in zip(images, found.images, strict=True):
            summary["corrected"] = correction.as_dict()


def _require_sense(
    motion: str, calibration: "Calibration | None", poisson_ratio: float, alignment: "Alignment | None"
) -> None:
    from dic.errors import CorrelationError
    from dic.out_of_plane.correct import MOTIONS, require_poisson_ratio

    checks = [
        (motion in MOTIONS, "motion", f"one of {', '.join(MOTIONS)}", motion, "correct --motion"),
        (
            motion == "free" or calibration is not None,
            "correct for motion out of the plane",
            "a calibration, which knows the camera's place",
            f"--motion {motion} without one",
            "name it with --calibration",
        ),
        (
            alignment is None or motion == "rigid",
            "apply alignment",
            "--motion rigid",
            motion,
            "an alignment serves rotations only",
        ),
    ]
    require_poisson_ratio(poisson_ratio)
    for good, step, expected, got, remedy in checks:
        if not good:
            raise CorrelationError("settings", step, expected, got, remedy)


def corrected_text(corrected: dict[str, Any]) -> str:
    """Return a correction in a line, or why there is none."""
    if not corrected["applied"]:
        return f"not corrected: {corrected['reason']}"
    values = ", ".join(
        "–"
        if corrected[name] is None
        else f"{1e6 * corrected[name]:z.0f} ± {1e6 * corrected[f'{name}_std']:.0f}"
        for name in ("exx", "eyy", "exy")
    )
    slopes = ", ".join(f"{corrected[f'slope_{axis}_deg']:+z.3f}°" for axis in "xy")
    return f"corrected exx, eyy, exy {values} µε (slopes x, y {slopes})"
