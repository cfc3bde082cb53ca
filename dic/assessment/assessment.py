"""Test with simulated cameras how accurate a bicubic map is, and compare it with a pinhole model."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

from dic.assessment.models import NOISE_PX, ModelRow, compare_models
from dic.assessment.paper import BASE, CLAIM_PX, SWEEPS, Row, assess, claim_limit


@dataclass(frozen=True)
class Assessment:
    """Errors that remain when a bicubic map is fitted to exact grid points.

    Attributes
    ----------
    rows : tuple of Row
        One row for each simulated camera of each sweep, and for each set of points.
    findings : tuple of str
        One sentence for each sweep. The sentence says up to which angle or distortion the largest error on
        the base grid is below 0.02 px, as Helm and Deaner claim.
    models : tuple of ModelRow
        Errors of the bicubic map and of the pinhole model, one row for each simulated camera.
    noise_px : float
        Standard deviation, px, of the random noise in the image coordinates of grid points, for the errors
        `noisy_px` in `models`.
    """

    rows: tuple[Row, ...]
    findings: tuple[str, ...]
    models: tuple[ModelRow, ...]
    noise_px: float = NOISE_PX

    def __repr__(self) -> str:
        return "\n".join([f"Assessment of {len(self.rows)} cases:", *self.findings])

    def table(self) -> list[dict[str, Any]]:
        """Return `rows` as dictionaries, each with the number of the figure in Helm and Deaner's paper."""
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
        """Return all results as a dictionary for JSON; `docs/assessment.md` describes the keys."""
        models = [asdict(row) for row in self.models]
        return {"rows": self.table(), "findings": list(self.findings), "models": models}


def assess_method() -> Assessment:
    """Repeat Helm and Deaner's numerical assessment of their calibration; this takes about half a minute."""
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
