"""Draws a comparison: maps of our values, of the other program's values, and of their difference."""

from typing import Any

import numpy as np

from dic.comparison.difference import Comparison, Difference
from dic.pictures.marks import FONT_PT
from dic.typing import Float, Grey

_NAMES = {"u_px": "u to the right", "v_px": "v downwards", "exx": "εxx", "eyy": "εyy", "exy": "εxy"}
_PERCENTILES = (1.0, 99.0)
_WIDTH_IN = 2.3
_MARGIN_IN = 0.55
_LARGEST_MARKER_PT, _SMALLEST_MARKER_PT = 9.0, 0.6


def draw_comparison(comparison: Comparison, image: Grey) -> Any:
    """Return a matplotlib figure with one row of three maps for each quantity.

    `image`, shape (height, width): the reference image.
    """
    from matplotlib.figure import Figure

    shown = [each for each in comparison.differences.values() if np.isfinite(each.values).any()]
    points = comparison.peer.points_px
    height, width = image.shape
    aspect = np.clip(height / width, 0.3, 3.0)
    # The maps of a tall image fit the page better if the quantities are side by side.
    upright = aspect > 1.3
    width_in = _WIDTH_IN / (2.0 if upright else 1.0)
    across, along = (len(shown), 3) if upright else (3, len(shown))
    size_in = across * (width_in + 0.9), along * (width_in * aspect + _MARGIN_IN) + 0.4
    figure = Figure(figsize=size_in, layout="constrained")
    axes = figure.subplots(along, across, squeeze=False)
    marker = _marker_pt(points, width, width_in)
    for k, difference in enumerate(shown):
        row = axes[:, k] if upright else axes[k]
        _draw_row(figure, row, difference, comparison.peer.program, points, (image, marker))
    share = 100.0 * comparison.common / len(comparison.peer)
    title = (
        f"{comparison.common} of {len(comparison.peer)} points of {comparison.peer.program} ({share:.1f} %)"
    )
    figure.suptitle(title, fontsize=FONT_PT + 2)
    return figure


def _draw_row(
    figure: Any, row: Any, difference: Difference, program: str, points: Float, drawn: tuple[Grey, float]
) -> None:
    factor, unit = (1e3, "mpx") if difference.quantity.endswith("_px") else (1e6, "µε")
    scale, own = (1.0, "px") if difference.quantity.endswith("_px") else (1e6, "µε")
    name = _NAMES[difference.quantity]
    both = np.isfinite(difference.values)
    together = np.concatenate([difference.ours[both], difference.peer[both]]) * scale
    ends = float(np.percentile(together, _PERCENTILES[0])), float(np.percentile(together, _PERCENTILES[1]))
    far = float(np.percentile(np.abs(difference.values[both]), 98.0)) * factor or 1e-9
    maps: list[tuple[str, Float, str, tuple[float, float]]] = [
        (f"{name}, offaxis, {own}", difference.ours * scale, "viridis", ends),
        (f"{name}, {program}, {own}", difference.peer * scale, "viridis", ends),
        (f"offaxis − {program}, {unit}", difference.values * factor, "RdBu_r", (-far, far)),
    ]
    image, marker = drawn
    low, high = np.percentile(image, _PERCENTILES)
    for axis, (title, values, colours, (least, most)) in zip(row, maps, strict=True):
        axis.imshow(image, cmap="gray", vmin=low, vmax=high, alpha=0.5)
        use = both & np.isfinite(values)
        dots = axis.scatter(
            points[use, 0], points[use, 1], c=values[use], s=marker**2, marker="s", cmap=colours, vmin=least,
            vmax=most, linewidths=0,
        )  # fmt: skip
        axis.set_title(title, fontsize=FONT_PT)
        axis.set_axis_off()
        bar = figure.colorbar(dots, ax=axis, fraction=0.05, pad=0.02, extend="both")
        bar.ax.tick_params(labelsize=FONT_PT - 1, length=2, pad=1.5)


def _marker_pt(points: Float, width: int, width_in: float) -> float:
    """Return the width of a marker, pt, at which the markers of neighbouring points touch."""
    from scipy.spatial import KDTree

    spacing = float(width)
    if len(points) > 1:
        distances, _ = KDTree(points).query(points, k=[2])
        spacing = float(np.median(np.asarray(distances)))
    size = spacing / width * width_in * 72.0
    return float(np.clip(0.9 * size, _SMALLEST_MARKER_PT, _LARGEST_MARKER_PT))
