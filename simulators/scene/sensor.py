"""Convert light to grey levels, with photon noise, read noise, saturation and quantisation."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Sensor:
    """An image sensor as in the model of EMVA 1288: electrons with noise, a gain, and integer grey levels."""

    bits: int  # number of significant bits, 8 or 12
    # largest number of electrons in a pixel. At gain 1, this number gives the highest grey level.
    full_well_e: float
    read_noise_e: float  # standard deviation of the dark noise, in electrons
    # exposure time in µs in which a surface of reflectance 1 gives the largest number of electrons
    saturation_exposure_us: float

    @property
    def highest_grey(self) -> int:
        """The highest grey level of the sensor."""
        return (1 << self.bits) - 1

    def expose(
        self, reflectance: NDArray[np.float64], exposure_us: float, gain: float, rng: np.random.Generator
    ) -> NDArray[np.uint8] | NDArray[np.uint16]:
        """Return the grey levels of one exposure.

        The shot noise has a normal distribution with the variance of the Poisson distribution. Above some
        tens of electrons, the two distributions are almost equal. The variance of the read noise is added.
        """
        mean_e = reflectance * (self.full_well_e * exposure_us / self.saturation_exposure_us)
        noise_e = np.sqrt(mean_e + self.read_noise_e**2) * rng.standard_normal(mean_e.shape)
        held_e = np.minimum(mean_e + noise_e, self.full_well_e)
        grey = np.rint(held_e * (gain * self.highest_grey / self.full_well_e))
        grey = np.clip(grey, 0, self.highest_grey)
        return grey.astype(np.uint8) if self.bits == 8 else grey.astype(np.uint16)
