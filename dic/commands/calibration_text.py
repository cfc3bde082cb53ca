"""The summary of a calibration that `dic calibrate` prints, as JSON and as text."""

from __future__ import annotations

import math
from typing import Any

import dic

_MM_TO_UM = 1000.0
_OPEN_SHARE = 0.05
_MOST_DIGITS = 4


def summarise(calibration: dic.Calibration) -> dict[str, Any]:
    """Return a calibration's values as a dictionary; residuals and scale belong to the model in use."""
    grid, pinhole = calibration.grid, calibration.pinhole
    outline = calibration.outline_px
    x, y = outline[:, 0], outline[:, 1]
    height, width = calibration.image_shape
    cross_validation_px = {"bicubic": calibration.bicubic_cross_validation_px}
    if pinhole is not None:
        cross_validation_px["pinhole"] = pinhole.cross_validation_px
    return {
        "image": calibration.source,
        "images": calibration.images,
        "plate_mm": calibration.plate_mm,
        "width_px": width,
        "height_px": height,
        "lines": list(grid.lines),
        "pitch_mm": grid.pitch_mm,
        "orientation": grid.orientation,
        "found": grid.found,
        "expected": grid.expected,
        "model": calibration.model,
        "recommended": calibration.recommended,
        "recommendation": calibration.recommendation,
        **_lengths(calibration.residuals[calibration.model]),
        "mm_per_px": calibration.mm_per_px,
        "models": {
            model: _lengths(residuals) | {"left_out_px": _finite(cross_validation_px[model])}
            for model, residuals in calibration.residuals.items()
        },
        "camera": None if pinhole is None else _camera(pinhole, calibration.lens_remainder_px),
        "area_px2": float(abs((x * (y[[*range(1, len(y)), 0]] - y[[-1, *range(len(y) - 1)]])).sum()) / 2),
        "outline_px": outline.round(3).tolist(),
        "warnings": list(grid.warnings),
    }


def text(summary: dict[str, Any]) -> str:
    """Return the summary of a calibration as lines for a terminal, with both models side by side."""
    share = summary["area_px2"] / (summary["width_px"] * summary["height_px"])
    more = f", camera from {summary['images']} images" if summary["images"] > 1 else ""
    said_by = {"mark": ", axes by the mark", "option": ", axes as given"}
    axes = said_by.get(summary["orientation"], "")
    plate = f", surface {summary['plate_mm']:g} mm behind the lines" if summary["plate_mm"] else ""
    # A wrong pitch shows nowhere else: all lengths are then wrong by the same factor.
    width_mm, height_mm = (summary[side] * summary["mm_per_px"] for side in ("width_px", "height_px"))
    lines = [
        f"{summary['image']}: {summary['found']} of {summary['expected']} intersections{axes}{more}{plate}"
    ]
    lines += _table(summary["models"])
    lines += _camera_lines(summary["camera"])
    lines += [
        f"  recommended    {summary['recommendation']}",
        f"  in use         {summary['model']}; scale {summary['mm_per_px'] * _MM_TO_UM:.3f} µm/px "
        "at the middle of the grid",
        f"  picture        about {width_mm:.3g} × {height_mm:.3g} mm, if the pitch is right",
        f"  area           {summary['area_px2']:.0f} px², {share:.0%} of the image; "
        "points outside it are flagged",
    ]
    return "\n".join(lines)


def _lengths(residuals: dic.calibration.Residuals) -> dict[str, float]:
    return {
        "rms_px": residuals.rms_px,
        "max_px": residuals.max_px,
        "rms_um": residuals.rms_mm * _MM_TO_UM,
        "max_um": residuals.max_mm * _MM_TO_UM,
    }


def _camera(pinhole: dic.calibration.Pinhole, lens_remainder_px: float) -> dict[str, Any]:
    return {
        "focal_px": pinhole.focal_px,
        "focal_std_px": pinhole.focal_std_px,
        "principal_px": pinhole.principal_px.tolist(),
        "distortion": dict(zip(("k1", "k2", "p1", "p2", "k3"), pinhole.distortion.tolist(), strict=False)),
        "off_axis_deg": pinhole.off_axis_deg,
        "off_axis_std_deg": pinhole.off_axis_std_deg,
        "distance_mm": pinhole.distance_mm,
        "centre_mm": pinhole.centre_mm.tolist(),
        "centre_std_mm": pinhole.centre_std_mm.tolist(),
        "centre_covariance_mm2": pinhole.centre_covariance_mm2.tolist(),
        "rotation": pinhole.rotation.tolist(),
        "noise_px": pinhole.noise_px,
        "lens_remainder_px": lens_remainder_px,
        "grid": _grid(pinhole) if pinhole.deviation_covariance.any() else None,
    }


def _grid(pinhole: dic.calibration.Pinhole) -> dict[str, Any]:
    """Return the deviations of the target from its nominal shape."""
    std = pinhole.deviation_covariance.diagonal() ** 0.5
    (ratio, skew, *bow_mm), (ratio_std, skew_std, *bow_std_mm) = pinhole.deviations.tolist(), std.tolist()
    return {
        "scale_ratio": 1.0 + ratio,
        "scale_ratio_std": ratio_std,
        "skew_rad": skew,
        "skew_std_rad": skew_std,
        "bow_mm": bow_mm,
        "bow_std_mm": bow_std_mm,
    }


def _table(models: dict[str, Any]) -> list[str]:
    columns = "".join(f"{name:<24}" for name in models)
    rows = [f"{'':<17}{columns}".rstrip()]
    for title, name in (("residual rms", "rms"), ("maximum", "max")):
        cells = [f"{m[name + '_px']:.4f} px ({m[name + '_um']:.3f} µm)" for m in models.values()]
        rows.append(f"  {title:<15}" + "".join(f"{cell:<24}" for cell in cells).rstrip())
    left_out = [m["left_out_px"] for m in models.values()]
    cells = ["too few lines" if miss is None else f"{miss:.4f} px" for miss in left_out]
    rows.append(f"  {'left-out rms':<15}" + "".join(f"{cell:<24}" for cell in cells).rstrip())
    return rows


def _camera_lines(camera: dict[str, Any] | None) -> list[str]:
    if camera is None:
        return []
    centre = ", ".join(
        f"{axis} {_with_std(value, std)}"
        for axis, value, std in zip("XYZ", camera["centre_mm"], camera["centre_std_mm"], strict=True)
    )
    lines = [
        f"  focal length   {_with_std(camera['focal_px'], camera['focal_std_px'])} px",
        f"  off-axis       {_with_std(camera['off_axis_deg'], camera['off_axis_std_deg'])}°",
        f"  camera centre  {centre} mm",
    ]
    if camera["lens_remainder_px"] > 0:
        lines.append(
            f"  lens           {camera['lens_remainder_px']:.2g} px of its distortion need a remainder; more "
            "images of the tilted grid, or another lens, make the centre more certain"
        )
    if camera["grid"] is not None:
        lines += _target_lines(camera["grid"])
    share = camera["focal_std_px"] / camera["focal_px"]
    if share > _OPEN_SHARE:
        lines.append(
            f"                 the focal length is uncertain by {share:.0%}: give the focal length, "
            "the distance, or images of the tilted grid"
        )
    return lines


def _target_lines(grid: dict[str, Any]) -> list[str]:
    percent = _with_std(100.0 * (grid["scale_ratio"] - 1.0), 100.0 * grid["scale_ratio_std"])
    skew = _with_std(math.degrees(grid["skew_rad"]), math.degrees(grid["skew_std_rad"]))
    bows = zip(grid["bow_mm"], grid["bow_std_mm"], strict=True)
    along_x, twist, along_y = (_with_std(_MM_TO_UM * bow, _MM_TO_UM * std) for bow, std in bows)
    return [
        f"  target         X and Y scales differ by {percent} %, skew {skew}°",
        f"                 bow X {along_x}, Y {along_y}, twist {twist} µm",
    ]


def _with_std(value: float, std: float) -> str:
    """Return a value and its standard deviation as text.

    The standard deviation has two significant digits, but at most four decimals. The value is rounded to as
    many decimals as the standard deviation.
    """
    digits = max(0, 1 - math.floor(math.log10(std))) if std > 0 else _MOST_DIGITS
    digits = min(digits, _MOST_DIGITS)
    return f"{value:.{digits}f} ± {std:.{digits}f}"


def _finite(value: float) -> float | None:
    """Return None for NaN, which marks an unknown value, because JSON has no NaN."""
    return value if math.isfinite(value) else None
