"""Plots of the numerical assessment of the calibration, numbered as in Helm and Deaner's paper."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from dic.assessment.assessment import Assessment
from dic.assessment.paper import (
    CLAIM_PX,
    OVERSIZED,
    POINT_SETS,
    SWEEPS,
    PaperSweep,
    PointSet,
    Row,
    back_projected_error,
)
from dic.calibration.pinhole.camera import Pinhole
from dic.files.writing import write_figure
from dic.typing import PathLike

_CURVES = (("maximum_px", "maximum", "-o"), ("mean_px", "mean", "-s"), ("std_px", "standard deviation", "-^"))
# The margins are fixed, because matplotlib's automatic layout would take half of the command's time.
_MARGINS = {"left": 0.14, "right": 0.97, "bottom": 0.14, "top": 0.91}
_MAP_FIGURE = 5
_MAP_CAMERA = Pinhole.swung(pan_deg=30.0)


def plot_assessment(assessment: Assessment, folder: PathLike) -> list[Path]:
    """Write figures 2 to 14 and an overview as PNG files, and return their paths.

    Parameters
    ----------
    assessment : Assessment
    folder : path
        An existing folder, to which the PNG files are written.
    """
    from matplotlib.figure import Figure

    folder, rows = Path(folder), assessment.rows
    paths = []
    for sweep in SWEEPS:
        for points in POINT_SETS:
            figure = Figure(figsize=(6, 4))
            _draw_sweep(figure.subplots(gridspec_kw=_MARGINS), rows, sweep, points)
            paths.append(folder / f"figure_{sweep.figure(points):02d}.png")
            write_figure(figure, paths[-1], dpi=120)
    figure = Figure(figsize=(6, 5))
    _draw_map(figure, figure.subplots(gridspec_kw=_MARGINS))
    paths.append(folder / f"figure_{_MAP_FIGURE:02d}.png")
    write_figure(figure, paths[-1], dpi=120)

    overview = Figure(figsize=(20, 16))
    spacing = {"left": 0.04, "right": 0.98, "bottom": 0.04, "top": 0.94, "wspace": 0.22, "hspace": 0.35}
    axes = overview.subplots(4, 4, gridspec_kw=spacing)
    for line, sweep in zip(axes, SWEEPS, strict=True):
        for place, points in zip(line, POINT_SETS, strict=False):
            _draw_sweep(place, rows, sweep, points)
        line[3].set_axis_off()
    axes[0, 3].set_axis_on()
    _draw_map(overview, axes[0, 3])
    overview.suptitle("Numerical assessment: 2800 px pinhole, 40 mm, 10 × 10 mm grid of 21 × 21 points")
    paths.append(folder / "overview.png")
    write_figure(overview, paths[-1], dpi=80)
    return sorted(paths)


def _draw_sweep(axes: Any, rows: Sequence[Row], sweep: PaperSweep, points: PointSet) -> None:
    shown = [row for row in rows if row.sweep is sweep and row.points is points]
    values = [abs(row.value) for row in shown]
    for name, label, style in _CURVES:
        axes.plot(values, [getattr(row.error, name) for row in shown], style, markersize=3, label=label)
    axes.set_title(f"Figure {sweep.figure(points)}: {sweep.title}, {points.name} grid", fontsize=10)
    axes.set_xlabel(sweep.axis if shown[-1].value > 0 else f"− {sweep.axis}")
    axes.set_ylabel("error, px")
    if sweep.axis.startswith("distortion"):
        axes.set_xscale("log")
        axes.set_yscale("log")
    if points is not OVERSIZED:
        axes.axhline(CLAIM_PX, color="tab:gray", linestyle="--", linewidth=1, label="the paper's 0.02 px")
    axes.grid(alpha=0.3)
    axes.legend(fontsize=8)


def _draw_map(figure: Any, axes: Any) -> None:
    error = back_projected_error(_MAP_CAMERA, OVERSIZED)
    half = OVERSIZED.half_mm
    levels = np.linspace(0, 0.025 * np.ceil(error.max() / 0.025), 11)
    line = np.linspace(-half, half, OVERSIZED.count)
    filled = axes.contourf(line, line, error, levels=levels, cmap="viridis")
    figure.colorbar(filled, ax=axes, label="error, px")
    axes.plot([-5, 5, 5, -5, -5], [-5, -5, 5, 5, -5], color="white", linewidth=1.5)
    axes.set_aspect("equal")
    axes.set_xlabel("X, mm")
    axes.set_ylabel("Y, mm")
    axes.set_title(f"Figure {_MAP_FIGURE}: pan 30°, oversized grid; white: calibrated area", fontsize=10)
