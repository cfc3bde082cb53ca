"""The measurement of one correlated image, with all errors of its strain."""

from dataclasses import replace

from dic.calibration.calibration import Calibration
from dic.correlation.field import Field
from dic.out_of_plane.correct import correct
from dic.out_of_plane.correction import stated
from dic.out_of_plane.motion import Motion
from dic.results.finished import FinishedImage
from dic.strain import measurement
from dic.strain.measurement import Measurement
from dic.strain.settings import StrainSettings


def measure(
    field: Field,
    calibration: Calibration | None = None,
    strain: StrainSettings | None = None,
    *,
    label: str = "",
) -> Measurement:
    """Compute the displacements and strains of a correlated image.

    The standard deviations of calibrated strain contain the expected motion of a specimen out of the grid's
    plane.

    Parameters
    ----------
    field : Field
        The result of `Correlator.correlate` or `Series.correlate`.
    calibration : Calibration, optional
        Calibration of the camera, for results in millimetres. Without a calibration all results are in
        pixels.
    strain : StrainSettings, optional
    label : str
        The path of the image file, or the run's step to which the image belongs.

    Raises
    ------
    CorrelationError
        If an argument has the wrong type.
    """
    found = measurement.measure(field, calibration, strain, label=label)
    if calibration is None:
        return found
    return stated(found, correct([found], calibration, Motion()).images[0])


def measurement_of(
    found: FinishedImage, calibration: Calibration | None, strain: StrainSettings | None
) -> Measurement:
    """Return the displacements and strains of a correlated image, with the errors that the images cause."""
    made = measurement.measure(found.field, calibration, strain, label=found.label)
    return replace(made, digest=found.digest)
