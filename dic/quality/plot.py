"""A plot of an image's quality: noise floor, blur, autocorrelation of the pattern and grey levels."""

from typing import Any

import numpy as np

from dic.correlation.repetition import repeats
from dic.files.writing import write_figure
from dic.image.given import grey_image
from dic.quality.findings import FINEST_SPECKLE_PX
from dic.quality.picture import TILES
from dic.quality.quality import Quality
from dic.typing import Float, Grey, ImageLike, Indices, PathLike

WIDE = 1.75
"""An image that is wider than this multiple of its height is drawn above the other panels.

A narrower image is drawn beside the other panels.
"""


def draw_quality(quality: Quality, image: Grey) -> Any:
    """Return a matplotlib figure of an image's quality.

    The figure shows the noise floor and the blur over the image, the autocorrelation of the pattern, and a
    histogram of the grey levels.

    `image`, shape (height, width): the image whose quality was assessed.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(14, 8), layout="constrained")
    height, width = image.shape
    if width > WIDE * height:
        grid = figure.add_gridspec(2, 2, height_ratios=(3, 2))
        places = grid[0, :], grid[1, 0], grid[1, 1]
    else:
        grid = figure.add_gridspec(2, 2, width_ratios=(5, 3))
        places = grid[:, 0], grid[0, 1], grid[1, 1]
    over_image, pattern, levels = (figure.add_subplot(place) for place in places)
    _draw_floor(figure, over_image, quality, image)
    _draw_covariance(pattern, quality)
    _draw_levels(levels, quality, image)
    return figure


def plot_quality(quality: Quality, image: ImageLike, path: PathLike) -> None:
    """Write the figure from `draw_quality` as a PNG file."""
    write_figure(draw_quality(quality, grey_image(image, "image")), path, 100, "png")


def _draw_floor(figure: Any, axes: Any, quality: Quality, image: Grey) -> None:
    low, high = np.percentile(image, [0.5, 99.5])
    axes.imshow(image, cmap="gray", vmin=low, vmax=high)
    if not quality.region.all():
        axes.contour(quality.region, levels=[0.5], colors="tab:orange", linewidths=1)
    worst = quality.std_px.max(axis=1)
    known = np.isfinite(worst)
    x, y = quality.points.T
    floor = 1e3 * worst[known]
    top = float(np.percentile(floor, 95)) if known.any() else 1.0
    dots = axes.scatter(
        x[known], y[known], c=floor, cmap="turbo", vmin=0.0, vmax=top, s=40, edgecolors="white"
    )
    axes.plot(x[~known], y[~known], "x", color="tab:red", markersize=7, label="no pattern beyond noise")
    figure.colorbar(dots, ax=axes, label="noise floor of u or v, mpx")
    if not known.all():
        axes.legend(loc="lower right")
    rows, columns = np.nonzero(quality.region)
    for i, row in enumerate(_middles(rows)):
        for j, column in enumerate(_middles(columns)):
            if np.isfinite(quality.blur_px[i, j]):
                box = {"facecolor": "white", "alpha": 0.8, "edgecolor": "none", "pad": 2}
                text = f"blur {quality.blur_px[i, j]:.1f} px"
                axes.text(column, row, text, ha="center", va="center", bbox=box)
    settings = quality.settings
    axes.set_title(
        f"{settings.shape} subset of {settings.subset_px} px resolves {1e3 * quality.floor_px:.1f} mpx"
        f" (wanted {1e3 * quality.wanted_px:g}); noise {quality.noise:.2f} grey levels"
    )
    axes.set_axis_off()


def _middles(at: Indices) -> Float:
    edges = np.linspace(at.min(), at.max() + 1, TILES + 1)
    return (edges[1:] + edges[:-1]) / 2


def _draw_covariance(axes: Any, quality: Quality) -> None:
    for name, covariance, size in (
        ("x", quality.covariance_x, quality.speckle_x_px),
        ("y", quality.covariance_y, quality.speckle_y_px),
    ):
        axes.plot(covariance / covariance[0], ".-", label=f"along {name}: {size:.1f} px wide")
    axes.axhline(0.5, color="gray", linewidth=0.8)
    axes.axvline(FINEST_SPECKLE_PX / 2, color="tab:red", linewidth=0.8, label="finest speckle")
    axes.set(xlabel="lag, px", ylabel="autocorrelation of the pattern")
    if quality.repetition is not None:
        axes.set_title(repeats(quality.repetition), fontsize=10)
    axes.legend()


def _draw_levels(axes: Any, quality: Quality, image: Grey) -> None:
    levels = image[quality.region]
    # Each bin of the histogram is one grey level wide, or several if the image spans more than 256 levels.
    width = max(1.0, np.ceil((levels.max() - levels.min()) / 256))
    axes.hist(levels, bins=np.arange(levels.min() - 0.5, levels.max() + width, width), color="tab:blue")
    axes.set(xlabel="grey level", ylabel="pixels")
    axes.set_title(
        f"contrast {quality.contrast:.2f};"
        f" clipped {quality.dark_share:.1%} dark, {quality.bright_share:.1%} bright",
        fontsize=10,
    )
