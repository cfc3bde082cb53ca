"""The light on its way to the sensor of a simulated camera: lamps, glare, and what covers the lens."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from simulators.scene.warp import Shading

Array = NDArray[np.float64]

GLARE = 3.0
"""Light of a glare in units of a white surface: it saturates at each usual exposure."""
GLARE_EDGE_PX = 12.0
UNDER_COVER = 0.01
"""Part of the light that reaches a covered lens."""
COVER_EDGE_PX = 60.0
"""Width of the shadow's edge, because what covers a lens is out of focus."""


@dataclass(frozen=True)
class Light:
    """What faults do to the light of one exposure. The default is no fault.

    Attributes
    ----------
    factor : float
        Factor of the whole light.
    covered_px : float
        How far the shadow of what covers the lens reaches from the top of the image.
    glare_px : float
        Radius of the glare; 0 for none.
    glare_x, glare_y : float
        Its middle, as a part of the image's width and height.
    defocus_px, smear_px : float
        Standard deviation of the defocus, and length of the motion along x.
    """

    factor: float = 1.0
    covered_px: float = 0.0
    glare_px: float = 0.0
    glare_x: float = 0.5
    glare_y: float = 0.5
    defocus_px: float = 0.0
    smear_px: float = 0.0

    @property
    def keeps_sharp(self) -> bool:
        """True if each pixel depends on its own light only."""
        return self.defocus_px <= 0.0 and self.smear_px <= 1.0

    def shading(self, height: int, width: int, unit: float = 1.0) -> Shading:
        """Return the light as factors of rows and as light that is added, for reflectances times `unit`."""
        rows = np.full(height, self.factor)
        if self.covered_px > 0.0:
            depth = (self.covered_px - np.arange(height)) / COVER_EDGE_PX
            rows *= 1.0 - (1.0 - UNDER_COVER) * np.clip(depth, 0.0, 1.0)
        added, top, left = self._glare(height, width)
        return Shading(rows.astype(np.float32), (added * unit).astype(np.float32), top, left)

    def on(self, reflectance: Array) -> Array:
        """Return the light that reaches the sensor from a surface, shape (height, width)."""
        if self.defocus_px > 0.0:
            # Import here: the import of scipy.ndimage would delay each start of a virtual rig by a third of a
            # second.
            from scipy.ndimage import gaussian_filter

            reflectance = gaussian_filter(reflectance, self.defocus_px)
        if self.smear_px > 1.0:
            from scipy.ndimage import uniform_filter1d

            reflectance = uniform_filter1d(reflectance, int(self.smear_px), axis=1)
        if self == Light():
            return reflectance
        shading = self.shading(*reflectance.shape)
        light: Array = reflectance * shading.of_rows[:, None].astype(np.float64)
        height, width = shading.added.shape
        light[shading.top : shading.top + height, shading.left : shading.left + width] += shading.added
        return light

    def _glare(self, height: int, width: int) -> tuple[Array, int, int]:
        """Return the light of the glare, and the top and left of its part of the image."""
        if self.glare_px <= 0.0:
            return np.zeros((0, 0)), 0, 0
        x, y, reach = self.glare_x * (width - 1), self.glare_y * (height - 1), self.glare_px + GLARE_EDGE_PX
        columns = np.arange(max(0, int(x - reach)), min(width, int(x + reach) + 2))
        rows = np.arange(max(0, int(y - reach)), min(height, int(y + reach) + 2))
        off = np.hypot(*np.meshgrid(columns - x, rows - y)) - self.glare_px
        return GLARE * np.clip(1.0 - off / GLARE_EDGE_PX, 0.0, 1.0), int(rows[0]), int(columns[0])
