"""What a live measurement is asked to do, and what it prepares from images of grid and specimen."""

from collections.abc import Mapping, Set
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from numpy.typing import NDArray

from drivers.errors import DeviceError
from drivers.interfaces import CameraInfo
from rig.live.frame_ring import RingShape
from rig.mounting import Mounting
from rig.protocol.grid import AnyGrid
from rig.protocol.live_table import LiveTable

if TYPE_CHECKING:
    import dic
    from dic.live import LiveSetups
    from dic.pipeline import GridImages

DEVICE = "live gauges"
_MAKING = ("grid_made", "scale_ratio_std", "skew_std", "flatness_std_mm")
Images = Mapping[str, NDArray[Any]]


@dataclass(frozen=True)
class LiveJob:
    """The gauges of a run, and what its run file says about grid and mounting.

    Attributes
    ----------
    table : LiveTable
    grid : AnyGrid
        The table `[grid]` of the protocol.
    mounting : Mounting
        That of the protocol, completed by that of the rig file.
    thickness_mm : float
        Thickness of the specimen; NaN if it is not known.
    """

    table: LiveTable
    grid: AnyGrid
    mounting: Mounting
    thickness_mm: float = float("nan")


def ring_of(info: CameraInfo) -> RingShape:
    """Return how the frames of a camera are stored."""
    return RingShape((info.height_px, info.width_px), "uint8" if info.bits <= 8 else "uint16")


def prepared(job: LiveJob, grids: Images, references: Images) -> "LiveSetups":
    """Calibrate all cameras and prepare their references, as `dic process` does with the run file.

    Raise `DeviceError` if an image cannot be used, or a gauge lies where nothing can be measured.
    """
    import dic
    from dic.live import LiveHow, LiveSetups

    table = job.table
    try:
        of_grid = _grid_images(job, grids, references.keys())
        lines = {} if of_grid is None else of_grid.calibrations()
        how = LiveHow(
            table.declared, table.correlation(), _motion(job), job.mounting.plate_mm or 0.0, table.live()
        )
        return LiveSetups.of_run(references, lines, how)
    except dic.MeasurementError as error:
        where = f"{DEVICE}: {error.source}"
        raise DeviceError(where, error.step, error.expected, error.got, error.remedy) from error


def _grid_images(job: LiveJob, grids: Images, references: Set[str]) -> "GridImages | None":
    """Return the images of the grid: those of the earlier run that the table names, or the given ones."""
    from dic.pipeline import GridImages

    if job.table.grid_run is not None:
        earlier = GridImages.of_run(job.table.grid_run)
        if missing := sorted(references - earlier.images.keys()):
            remedy = "name a run that the same cameras recorded in live.grid_from"
            known = f"a camera of {earlier.source}: {', '.join(earlier.images)}"
            raise DeviceError(DEVICE, "take the grid from an earlier run", known, missing[0], remedy)
        # An earlier run may have had more cameras.
        return replace(earlier, images={name: earlier.images[name] for name in sorted(references)})
    if not grids:
        return None
    values = job.grid.model_dump()
    made = {name: values[name] for name in _MAKING}
    return GridImages.of_target(grids, job.grid.target, job.grid.counts, values, made)


def _motion(job: LiveJob) -> "dic.Motion | None":
    """Return the motion that `dic process` assumes for a test with a load."""
    import dic
    from dic.runfile.mounting import RunMounting

    table, mounting = job.table, job.mounting
    if table.motion == "free":
        return None
    declared = RunMounting(
        mounting.plate_mm or 0.0, mounting.hinge_mm, mounting.shift_std_um, mounting.fixed_face
    )
    settings = dic.CorrectionSettings()
    if table.poisson_ratio is not None:
        settings = replace(settings, poisson_ratio=table.poisson_ratio)
    return settings.completed(declared, job.thickness_mm, {}).motion("tension", "")
