"""The live measurement of all cameras of a run, prepared as the run file would be processed."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from numpy.typing import NDArray

from dic.calibration.area import calibrated_area
from dic.calibration.calibration import Calibration
from dic.calibration.directions import most_different
from dic.calibration.plate import behind
from dic.correlation.settings import CorrelationSettings
from dic.errors import CalibrationError
from dic.gauges.declared import Gauge
from dic.live.pair import surface_of
from dic.live.settings import LiveSettings
from dic.live.setup import LiveSetup
from dic.out_of_plane.motion import Motion
from dic.out_of_plane.reference_surface import ReferenceSurface
from dic.specimen.find import SpecimenNotFound


@dataclass(frozen=True)
class LiveHow:
    """What the live measurements of all cameras share.

    Attributes
    ----------
    gauges : sequence of Gauge
    correlation : CorrelationSettings
    motion : Motion, optional
        Expected motion of the specimen. Default: strains are not corrected.
    plate_mm : float
        Distance of the specimen's surface behind the grid's lines.
    live : LiveSettings
    """

    gauges: Sequence[Gauge]
    correlation: CorrelationSettings = field(default_factory=CorrelationSettings)
    motion: Motion | None = None
    plate_mm: float = 0.0
    live: LiveSettings = field(default_factory=LiveSettings)


@dataclass(frozen=True)
class LiveSetups:
    """The set-ups of the cameras of a run.

    Attributes
    ----------
    cameras : mapping of str to LiveSetup
        By the names of the cameras.
    pair : tuple of str or None
        The two cameras that correct one another's strain, the more oblique one first.
    surface : ReferenceSurface or None
        Place of the surface that the pair sees in the reference.
    """

    cameras: Mapping[str, LiveSetup]
    pair: tuple[str, str] | None = None
    surface: ReferenceSurface | None = None

    def __repr__(self) -> str:
        return f"LiveSetups({', '.join(self.cameras)})"

    @classmethod
    def of_run(
        cls,
        references: Mapping[str, NDArray[Any]],
        lines: Mapping[str, Calibration],
        how: LiveHow,
    ) -> "LiveSetups":
        """Prepare all cameras of a run, so that live strains equal those of `dic.process_run`.

        Like there, a camera measures the specimen, which is found by its speckles in the calibrated area, or
        the whole of this area. Two cameras correct together if the motion is a tension.

        Parameters
        ----------
        references : mapping of str to ndarray, shape (height, width)
            The reference image of each camera; for several frames of the reference, their mean.
        lines : mapping of str to Calibration
            Calibrations by the grid's lines, as from `dic.pipeline.GridImages`. A camera without one measures
            raw strain.
        how : LiveHow

        Raises
        ------
        MeasurementError
            If a reference cannot be used, or a gauge has no points in it.
        """
        cameras = {name: _setup(image, lines.get(name), how) for name, image in references.items()}
        pair = None
        if how.motion is not None:
            pair = most_different({name: setup.calibration for name, setup in cameras.items()})
        surface = None if pair is None else surface_of(cameras[pair[0]], cameras[pair[1]])
        return cls(cameras, pair, surface)


def _setup(reference: NDArray[Any], lines: Calibration | None, how: LiveHow) -> LiveSetup:
    if lines is None:
        return LiveSetup(reference, how.gauges, correlation=how.correlation, live=how.live)
    if lines.image_shape != reference.shape:
        (height, width), (own_height, own_width) = lines.image_shape, reference.shape
        raise CalibrationError(
            lines.source or "images of the grid",
            "apply calibration",
            f"images of {own_width} × {own_height} px, as the reference",
            f"{width} × {height} px",
            "take both images with the same readout of the camera",
        )
    calibration = behind(lines, how.plate_mm) if how.plate_mm else lines
    area = calibrated_area(lines, reference.shape)
    motion = None if calibration.pinhole is None else how.motion
    setup = LiveSetup(
        reference, how.gauges, calibration, how.correlation, within=area, motion=motion, live=how.live
    )
    try:
        setup.correlator  # noqa: B018  # finds the specimen
    except SpecimenNotFound:
        return replace(setup, region=area, within=None)
    return setup
