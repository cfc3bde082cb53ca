"""From light to grey levels: photon noise, read noise, saturation and quantisation, in electrons."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Sensor:
    """An image sensor described as EMVA 1288 does: electrons with noise, a gain, whole grey levels.

    Attributes
    ----------
    bits : int
        8 or 12 significant bits.
    full_well_e : float
        Electrons a pixel holds; at gain 1 they give the highest grey level.
    read_noise_e : float
        Standard deviation of the dark noise.
    saturation_exposure_us : float
        Exposure time in which a surface of reflectance 1 fills the well.
    """

    bits: int
    full_well_e: float
    read_noise_e: float
    saturation_exposure_us: float

    @property
    def highest_grey(self) -> int:
        """The highest grey level."""
        return (1 << self.bits) - 1

    def expose(
        self, reflectance: NDArray[np.float64], exposure_us: float, gain: float, rng: np.random.Generator
    ) -> NDArray[np.uint8] | NDArray[np.uint16]:
        """Return the grey levels of one exposure.

        Shot noise is normal with the variance of the Poisson distribution it stands for, which is close above
        some tens of electrons; read noise adds to it.
        """
        mean_e = reflectance * (self.full_well_e * exposure_us / self.saturation_exposure_us)
        noise_e = np.sqrt(mean_e + self.read_noise_e**2) * rng.standard_normal(mean_e.shape)
        held_e = np.minimum(mean_e + noise_e, self.full_well_e)
        grey = np.rint(held_e * (gain * self.highest_grey / self.full_well_e))
        grey = np.clip(grey, 0, self.highest_grey)
        return grey.astype(np.uint8) if self.bits == 8 else grey.astype(np.uint16)
