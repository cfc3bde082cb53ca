"""The lines that `dic correlate` prints for each image: points, strains and correction."""

import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from dic.commands.strain_table import COMPONENTS, Column, StrainTable, share_text

_OTHERS = ("images", "calibration", "mounting", "model", "still")
"""All parts of the standard deviation except the shift; see `dic.out_of_plane.strain_parts`."""
_LOST_MIN = 0.03
"""A loss of the amplitude of local strain is printed if it is at least this fraction."""
_THINNING_MIN_UM = 0.1
_NAME_WIDTH_MAX = 24
_ROTATION_WIDTH = 8


def series_table(names: Sequence[str], *, only_raw: bool) -> StrainTable:
    """Return the table of a series for images with these names; `only_raw` is True without a calibration."""
    width = min(_NAME_WIDTH_MAX, max(len(name) for name in ("image", *names)))
    rotation = Column("rotation", _ROTATION_WIDTH)
    columns = [Column("image", width, number=False), Column("% points", len("% points")), rotation]
    return StrainTable(columns, only_raw)


def image_lines(table: StrainTable, summary: dict[str, Any], *, first: bool = True) -> list[str]:
    """Return the lines that `dic correlate` prints for an image: its strains, and notes about them.

    Notes that apply to the whole series are printed with the first image.

    `table`: the table of the series. `summary`: the result of `Measurement.summary`. If the strain of the
    image was corrected, the key "corrected" has the corrected values.
    """
    rotation_deg = summary["raw"]["rotation_deg"]
    rotation = "" if rotation_deg is None else f"{rotation_deg:z.2f}°"
    cells = [name_of(summary["file"]), share_text(summary), rotation]
    notes = [text for text in (_points_text(summary), *_settings_texts(summary, first)) if text]
    notes += summary.get("remarks", [])
    corrected = summary.get("corrected", {"method": "none"})
    if corrected["method"] != "none":
        notes += corrected_texts(corrected)
    return table.lines(cells, strains_of(summary)) + [f"  {note}" for note in notes]


def corrected_lines(table: StrainTable, summary: dict[str, Any]) -> list[str]:
    """Return the lines about an image's correction, if it is known only after the whole series."""
    strains = strains_of(summary)
    kind = "corrected" if "corrected" in strains else "calibrated"
    lines = table.lines([name_of(summary["file"]), "", ""], {kind: strains[kind]})
    return [*lines, *(f"  {text}" for text in corrected_texts(summary["corrected"]))]


def strains_of(summary: Mapping[str, Any]) -> dict[str, Mapping[str, Any]]:
    """Return the mean strains that were measured, by their kind: raw, calibrated and corrected.

    If there is a calibration, raw strain is returned without standard deviations, because the noise alone is
    a small part of its error. For the same reason, calibrated strain has standard deviations only if they
    contain the motion out of the grid's plane. If the strain was not corrected, corrected strain is left out.
    """
    if "calibrated" not in summary:
        return {"raw": summary["raw"]}
    corrected, unknown = summary.get("corrected", {}), {f"{name}_std": None for name in COMPONENTS}
    calibrated = summary["calibrated"]
    strains = {
        "raw": summary["raw"] | unknown,
        # Standard deviations in result files of earlier versions contain the noise alone.
        "calibrated": calibrated if "exx_std_images" in calibrated else calibrated | unknown,
    }
    return strains | ({"corrected": corrected} if corrected.get("applied") else {})


def name_of(file: str) -> str:
    """Return the name of an image file without its folder."""
    return Path(file).name


def _points_text(summary: dict[str, Any]) -> str:
    """Return the numbers of points without a value, by reason; "" if every point has a value."""
    lost = ", ".join(f"{count} {reason}" for reason, count in summary["failures"].items())
    return f"{summary['points'] + summary['out_of_view']} points: {lost}" if lost else ""


def _settings_texts(summary: dict[str, Any], first: bool) -> Iterator[str]:
    """Yield notes about the effects of the settings, and of earlier images in the series, on this image."""
    lost = {name: share for name, share in summary["strain"]["amplitude_lost"].items() if share is not None}
    if any(share >= _LOST_MIN for share in lost.values()):
        shares = ", ".join(f"{name} {100 * share:.0f} %" for name, share in lost.items())
        yield f"local strain loses amplitude to the settings: {shares}"
    if first and summary["interpolation"]["smoothing_px"] > 0.0:
        yield f"all images smoothed by {summary['interpolation']['smoothing_px']:g} px"
    if summary["updates"]:
        yield f"over {summary['updates']} new references"


def corrected_texts(corrected: dict[str, Any]) -> list[str]:
    """Return the results of a correction except the strain, or the reason why there is no correction.

    Each text fits a line of 100 characters. Only a reason may be longer.

    `corrected`: the result of `Correction.as_dict`.
    """
    notes = _other_shifts(corrected)
    if not corrected["applied"]:
        return [f"not corrected: {corrected['reason']}", *notes]
    slopes = ", ".join(f"{axis} {corrected[f'slope_{axis}_deg']:+z.3f}°" for axis in "xy")
    plane, share = f"slopes {slopes}", _shift_text(corrected)
    if corrected.get("shift_mm") is None:
        return [f"{plane}; {share}" if share else plane, *notes]
    shift = f"shift {1e3 * corrected['shift_mm']:+z.1f} ± {1e3 * corrected['shift_mm_std']:.1f} µm"
    return [f"{plane}, {shift}", *([share] if share else []), *notes]


def _other_shifts(corrected: dict[str, Any]) -> list[str]:
    """Return texts on the shift by thinning, and on a shift that the contraction shows unexpectedly."""
    texts = []
    if abs(corrected.get("thinning_um", 0.0)) >= _THINNING_MIN_UM:
        texts.append(f"the specimen became thinner: shift {corrected['thinning_um']:+z.1f} µm, corrected")
    if corrected.get("contraction_contradicts"):
        shown = f"{corrected['contraction_um']:+.0f} ± {corrected['contraction_std_um']:.0f} µm"
        texts.append(f"the contraction shows an unexpected shift of {shown}, or another Poisson's ratio")
    return texts


def _shift_text(corrected: dict[str, Any]) -> str:
    """Return a text on the part of the uncertainty due to the shift; "" if there is no such part."""
    if "exx_std_shift" not in corrected:
        return ""
    shift = 1e6 * corrected["exx_std_shift"]
    others = ", ".join(
        f"{1e6 * math.sqrt(sum(corrected.get(f'{name}_std_{part}', 0.0) ** 2 for part in _OTHERS)):.0f}"
        for name in ("exx", "eyy", "exy")
    )
    return f"± {shift:.0f} µε of exx and eyy is the shift, ± {others} all else"
