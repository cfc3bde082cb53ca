"""Opens the live measurement of a run: in a process of its own, or at once in simulated time."""

from collections.abc import Mapping

from drivers.clock import Clock, VirtualClock
from drivers.interfaces import CameraInfo
from rig.live.at_once import LiveAtOnce
from rig.live.beside import LiveProcess
from rig.live.job import LiveJob
from rig.live.values import LiveMeasurement
from rig.mounting import Mounting
from rig.protocol.grid import AnyGrid
from rig.protocol.live_table import LiveTable


def open_live(
    table: LiveTable,
    cameras: Mapping[str, CameraInfo],
    clock: Clock,
    *,
    grid: AnyGrid,
    mounting: Mounting,
    thickness_mm: float,
) -> LiveMeasurement:
    """Open the live measurement of a run.

    Its process is started at once, so that it is there when the images for `LiveMeasurement.prepare` are.

    Parameters
    ----------
    table : LiveTable
    cameras : mapping of str to CameraInfo
        The cameras of the rig.
    clock : Clock
        The clock of the run. With a `VirtualClock`, frames are measured while simulated time stands still.
    grid : AnyGrid
        The table `[grid]` of the protocol.
    mounting : Mounting
        That of the protocol, completed by that of the rig file.
    thickness_mm : float
        Thickness of the specimen; NaN if it is not known.

    Raises
    ------
    DeviceError
        If the process cannot be started.
    """
    job = LiveJob(table, grid, mounting, thickness_mm)
    if isinstance(clock, VirtualClock):
        return LiveAtOnce(job, cameras, clock)
    return LiveProcess(job, cameras)
