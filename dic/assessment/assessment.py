"""The whole assessment: the table of errors, where the paper's claim holds, and both models side by side."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

from dic.assessment.models import NOISE_PX, ModelRow, compare_models
from dic.assessment.paper import BASE, CLAIM_PX, SWEEPS, Row, assess, claim_limit


@dataclass(frozen=True)
class Assessment:
    """What the bicubic map leaves of perfect grid points.

    Attributes
    ----------
    rows : tuple of Row
        One for each sweep, value and point set.
    findings : tuple of str
        For each sweep a sentence that says whether the paper's claim holds.
    models : tuple of ModelRow
        The pinhole model beside the bicubic map.
    noise_px : float
        Standard deviation of one image coordinate of the noisy grid points of `models`.
    """

    rows: tuple[Row, ...]
    findings: tuple[str, ...]
    models: tuple[ModelRow, ...]
    noise_px: float = NOISE_PX

    def __repr__(self) -> str:
        return "\n".join([f"Assessment of {len(self.rows)} cases:", *self.findings])

    def table(self) -> list[dict[str, Any]]:
        """Return the rows as tables and programs have them, with the number of the paper's figure."""
        return [
            {
                "sweep": row.sweep.name,
                "value": row.value,
                "grid": row.points.name,
                "figure": row.sweep.figure(row.points),
                "mean_px": row.error.mean_px,
                "maximum_px": row.error.maximum_px,
                "std_px": row.error.std_px,
            }
            for row in self.rows
        ]

    def as_dict(self) -> dict[str, Any]:
        """Return everything for programs, JSON-ready: see `docs/assessment.md`."""
        models = [asdict(row) for row in self.models]
        return {"rows": self.table(), "findings": list(self.findings), "models": models}


def assess_method() -> Assessment:
    """Repeat the paper's numerical assessment of the calibration; it takes half a minute."""
    rows = assess()
    return Assessment(tuple(rows), tuple(_findings(rows)), tuple(compare_models()))


def _findings(rows: Sequence[Row]) -> list[str]:
    sentences = []
    for sweep in SWEEPS:
        last = next(
            row for row in rows if row.sweep is sweep and row.points is BASE and row.value == sweep.values[-1]
        )
        reached = f"{sweep.title}: maximum {last.error.maximum_px:.4f} px at {last.value:g} on the base grid"
        limit = claim_limit(sweep)
        holds = "holds throughout" if limit is None else f"does not hold beyond {limit:.3g}"
        sentences.append(f"{reached}; the claim of less than {CLAIM_PX} px {holds}")
    return sentences
