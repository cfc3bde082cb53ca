"""The light and the focus of a picture, with or without a speckle pattern."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from dic.quality.noise import noise_of_one
from dic.quality.speckle import edge_blur
from dic.typing import Float, Grey, Mask

TILES = 3
"""Number of tiles, along the width and along the height of the image, in which the focus is judged."""


@dataclass(frozen=True, kw_only=True)
class PictureValues:
    """Values that describe the light and the focus of a picture."""

    dark_share: float
    bright_share: float
    """Share of pixels at the lowest grey level of the image, and share of pixels at the highest grey level.
    If the highest grey level of the sensor is known, `bright_share` is the share of pixels at that level.
    """
    contrast: float
    """Michelson contrast (bright - dark) / (bright + dark), where bright and dark are the 98th and the 2nd
    percentile of the grey levels.
    """
    blur_px: Float
    """Shape (3, 3). Standard deviation of the blur at edges, for each ninth of the region; NaN for a ninth
    with too few edges.
    """

    def figures(self) -> dict[str, float]:
        """Return a dict of the values that `docs/quality.md` explains; an unknown value is NaN."""
        blur = self.blur_px[np.isfinite(self.blur_px)]
        return {
            "dark_share": self.dark_share,
            "bright_share": self.bright_share,
            "contrast": self.contrast,
            "blur_px": float(np.median(blur)) if blur.size else np.nan,
            "worst_blur_px": float(blur.max()) if blur.size else np.nan,
        }

    def as_dict(self) -> dict[str, Any]:
        """Return the dict of `figures` in a form for JSON, with None instead of NaN."""
        return {name: value if np.isfinite(value) else None for name, value in self.figures().items()}


def assess_picture(
    grey: Grey, region: Mask | None = None, *, noise: float | None = None, full_level: float | None = None
) -> PictureValues:
    """Return values for the light and the focus of a picture, with or without a speckle pattern.

    `region`, shape (height, width): pixels to use. Default: all pixels. `noise`: standard deviation of the
    noise, grey levels. By default the function estimates the noise from the picture. `full_level`: highest
    grey level of the sensor. Default: the highest grey level of the picture.
    """
    region = np.ones(grey.shape, np.bool_) if region is None else region
    noise = noise_of_one(grey, region) if noise is None else noise
    levels = grey[region]
    dark, bright = np.percentile(levels, (2, 98))
    return PictureValues(
        dark_share=float(np.mean(levels == grey.min())),
        bright_share=float(np.mean(levels >= (grey.max() if full_level is None else full_level))),
        contrast=float((bright - dark) / max(abs(bright + dark), 1e-9)),
        blur_px=_blur_in_tiles(grey, region, noise),
    )


def _blur_in_tiles(grey: Grey, region: Mask, noise: float) -> Float:
    rows, columns = np.nonzero(region)
    down = np.linspace(rows.min(), rows.max() + 1, TILES + 1).astype(int)
    across = np.linspace(columns.min(), columns.max() + 1, TILES + 1).astype(int)
    blur = np.full((TILES, TILES), np.nan)
    for i in range(TILES):
        for j in range(TILES):
            tile = (slice(down[i], down[i + 1]), slice(across[j], across[j + 1]))
            blur[i, j] = edge_blur(grey[tile], region[tile], noise)
    return blur
