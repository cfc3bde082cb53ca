"""Settings of the recorder: the table ``[recording]`` of a rig file."""

from pydantic import Field

from drivers.settings import Settings


class RecordingSettings(Settings):
    """Number of images that may wait for the disk, and times of synchronisation with the disk.

    The settings cannot switch off that the run file is synchronised with the disk (`fsync`) after every
    finished step and at the end of the run. Synchronised data survive a power failure. Data that are only
    written survive the end of a killed program.
    """

    # largest number of images of each camera that may wait to be written. If more images arrive, the run
    # ends.
    queue_frames: int = Field(default=48, ge=1, le=1000)
    # number of images after which the file is synchronised. With 1 this happens after every image.
    sync_frames: int = Field(default=32, ge=1, le=10000)
    # longest time in s between a write and the following synchronisation
    sync_s: float = Field(default=1.0, gt=0.0, le=3600.0)
    # the longest time that a write or a synchronisation may take. The run ends if the disk takes longer.
    answer_s: float = Field(default=30.0, gt=0.0, le=3600.0)
