"""The text that `dic correlate` prints for each image: points, strains and correction."""

import math
from pathlib import Path
from typing import Any

_OTHERS = ("images", "calibration", "mounting", "model")
"""Parts of the standard deviation beside the shift; see `dic.out_of_plane.strain_parts`."""
_LOST_MIN = 0.03
"""Smallest fraction of the amplitude of local strain whose loss is printed."""


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
    lost = {name: share for name, share in summary["strain"]["amplitude_lost"].items() if share is not None}
    if any(share >= _LOST_MIN for share in lost.values()):
        shares = ", ".join(f"{name} {100 * share:.0f} %" for name, share in lost.items())
        parts.append(f"local strain loses amplitude to the settings: {shares}")
    if summary["interpolation"]["smoothing_px"] > 0.0:
        parts.append(f"images smoothed by {summary['interpolation']['smoothing_px']:g} px")
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
        return f"not corrected: {corrected['reason']}{_open_text(corrected)}"
    values = ", ".join(
        "–"
        if corrected[name] is None
        else f"{1e6 * corrected[name]:z.0f} ± {1e6 * corrected[f'{name}_std']:.0f}"
        for name in ("exx", "eyy", "exy")
    )
    plane = "slopes x, y " + ", ".join(f"{corrected[f'slope_{axis}_deg']:+z.3f}°" for axis in "xy")
    if corrected.get("shift_mm") is not None:
        plane += f", shift {1e3 * corrected['shift_mm']:+z.1f} ± {1e3 * corrected['shift_mm_std']:.1f} µm"
    return f"corrected exx, eyy, exy {values} µε ({plane}){_shift_text(corrected)}"


def _open_text(corrected: dict[str, Any]) -> str:
    """Return a text about the uncertainty of calibrated strain, or "" if it is not known."""
    if "calibrated_exx_std" not in corrected:
        return ""
    stds = ", ".join(f"{1e6 * corrected[f'calibrated_{name}_std']:.0f}" for name in ("exx", "eyy", "exy"))
    return f"; calibrated strain is uncertain by ± {stds} µε, because the specimen may leave the grid's plane"


def _shift_text(corrected: dict[str, Any]) -> str:
    """Return a text about the part of the uncertainty that the shift causes, or "" if there is none."""
    if "exx_std_shift" not in corrected:
        return ""
    shift = 1e6 * corrected["exx_std_shift"]
    others = ", ".join(
        f"{1e6 * math.sqrt(sum(corrected[f'{name}_std_{part}'] ** 2 for part in _OTHERS)):.0f}"
        for name in ("exx", "eyy", "exy")
    )
    return f", of which ± {shift:.0f} µε of exx and eyy is the shift, and ± {others} all else"


def _strain_text(strain: dict[str, Any]) -> str:
    values = (strain["exx"], strain["eyy"], strain["exy"])
    return "exx, eyy, exy " + ", ".join("–" if v is None else f"{1e6 * v:z.0f}" for v in values) + " µε"
