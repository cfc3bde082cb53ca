"""The recorder writes the run file on a separate thread, and reports when data are on the disk."""

from rig.recorder.recorder import Recorder, run_file_exists
from rig.recorder.records import InterlockRecord, RunHeader, StepRecord

__all__ = ["InterlockRecord", "Recorder", "RunHeader", "StepRecord", "run_file_exists"]
