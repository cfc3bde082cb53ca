"""The text that `dic correlate` prints for each image: points, strains and correction."""

from pathlib import Path
from typing import Any


def image_text(summary: dict[str, Any]) -> str:
    """Return the line that `dic correlate` prints for an image.

    Parameters
    ----------
    summary : dict
        The result of `Measurement.summary`. If the strain of the image was corrected, the key "corrected"
        holds the corrected values.
    """
    share = 100.0 * summary["converged"] / max(1, summary["points"])
    parts = [
        f"{Path(summary['file']).name}: {summary['converged']} of {summary['points']} points ({share:.1f} %)"
    ]
    for kind in ("raw", "calibrated"):
        if kind in summary:
            parts.append(f"{kind} " + _strain_text(summary[kind]))
    if summary.get("corrected", {"method": "none"})["method"] != "none":
        parts.append(corrected_text(summary["corrected"]))
    parts.append(f"rotation {summary['raw']['rotation_deg'] or 0.0:.3f}°, start from {summary['start']}")
    if summary["updates"]:
        parts.append(f"over {summary['updates']} new references")
    return "; ".join(parts)


def corrected_text(corrected: dict[str, Any]) -> str:
    """Return a line with the corrected strains, or with the reason why there is no correction.

    Parameters
    ----------
    corrected : dict
        The result of `Correction.as_dict`.
    """
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


def _strain_text(strain: dict[str, Any]) -> str:
    values = (strain["exx"], strain["eyy"], strain["exy"])
    return "exx, eyy, exy " + ", ".join("–" if v is None else f"{1e6 * v:z.0f}" for v in values) + " µε"
