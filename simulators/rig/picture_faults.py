"""Faults of the pictures that the simulated cameras take. No driver can notice these faults."""

import numpy as np
from numpy.typing import NDArray

from drivers.clock import Clock
from drivers.errors import LinkLost
from simulators.wire.faults import PICTURE, FaultPanel


class PictureFaults:
    """Changes the light that reaches the sensor, and makes cameras unreachable for a time.

    `clock` is the clock of the rig, which determines when an unreachable camera becomes reachable again.
    The faults are switched on the attribute `panel`.
    """

    def __init__(self, clock: Clock) -> None:
        self.panel = FaultPanel(PICTURE)
        self._clock = clock
        self._absent_until_s: dict[str, float] = {}

    def frozen(self) -> bool:
        """Return True if the next frame shows the same picture as the previous frame."""
        return self.panel.take("frozen") is not None

    def alter(self, reflectance: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the light that reaches the sensor, after the faults have changed `reflectance`."""
        sigma_px, length_px, percent = (self.panel.take(name) for name in ("defocus", "blur", "light"))
        if sigma_px is not None:
            # Import here: the import of scipy.ndimage would delay each start of a virtual rig by a third of a
            # second.
            from scipy.ndimage import gaussian_filter

            reflectance = gaussian_filter(reflectance, float(sigma_px))
        if length_px is not None:
            from scipy.ndimage import uniform_filter1d

            reflectance = uniform_filter1d(reflectance, max(1, int(length_px)), axis=1)
        if percent is not None:
            reflectance = reflectance * (float(percent) / 100.0)
        return reflectance

    def require_present(self, name: str, step: str) -> None:
        """Raise `LinkLost` while the camera `name` is unreachable.

        The camera becomes unreachable at the first call with the fault switched on.
        """
        absent_s = self.panel.take("dropout") if step in ("grab", "stream") else None
        if absent_s is not None:
            self._absent_until_s[name] = self._clock.now_s() + float(absent_s)
        if self._clock.now_s() < self._absent_until_s.get(name, -np.inf):
            raise LinkLost(
                name, step, "a camera on its cable", "none", "plug the camera in and open it again"
            )
