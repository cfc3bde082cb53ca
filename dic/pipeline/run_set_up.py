"""The inputs from which strains are computed from a run's displacement fields; writes the result file."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dic.correlation.settings import CorrelationSettings
from dic.image.memory import give_back_memory
from dic.image.stored import is_large
from dic.image.threads import one_ahead
from dic.pipeline.camera_result import CameraResult
from dic.pipeline.run_corrections import CorrectedStep, CorrectionSettings, RunCorrector
from dic.pipeline.run_result_file import RunResultWriter
from dic.results.job import Job
from dic.results.provenance import Provenance
from dic.runfile.reader import RunInfo
from dic.strain.strain import StrainSettings


@dataclass(frozen=True)
class RunSetUp:
    """A run, and the inputs that are needed to compute strains from the run's displacement fields.

    Attributes
    ----------
    source : str
        Path of the run file.
    info : RunInfo
    settings : CorrelationSettings
        Settings of the correlation that gave the fields.
    strain : StrainSettings
    correcting : CorrectionSettings
        Settings of the corrections, with the values that the run file declares.
    plate_mm : float
        Distance of the specimen's surface behind the grid's lines.
    """

    source: str
    info: RunInfo
    settings: CorrelationSettings
    strain: StrainSettings
    correcting: CorrectionSettings
    plate_mm: float

    def as_dict(self) -> dict[str, Any]:
        """Return a dict for JSON of all values that determine strain and corrections."""
        correcting = json.loads(self.correcting.as_text())
        return {"strain": vars(self.strain), "correcting": correcting, "plate_mm": self.plate_mm}

    def write(self, path: Path, cameras: Sequence[CameraResult], origin: Provenance) -> None:
        """Correct the strains of all steps one by one, and write the result file."""
        corrector = RunCorrector(cameras, self.correcting)
        outlines = []
        with RunResultWriter(path, cameras, origin, corrector.pair) as writer:
            steps = map(CorrectedStep.evaluated, corrector.steps())
            # Two steps of large images would need too much memory at the same time.
            large = any(is_large(camera.reference.shape) for camera in cameras)
            for step in steps if large else one_ahead(steps):
                writer.add(step)
                outlines.append(step.outline)
                if large:
                    # Free most of the memory of this step before the next one is computed.
                    del step
                    give_back_memory()
            corrections = corrector.corrections(outlines)
            writer.finish(self.source, self.info, self.settings, self.correcting, corrections)


def strain_of_job(job: Job) -> StrainSettings:
    """Return the strain settings with which the result of a run was computed."""
    return StrainSettings(**json.loads(job.strains)["strain"])


def plate_of_job(job: Job) -> float:
    """Return the distance of the surface behind the grid's lines with which a result was computed, mm."""
    return float(json.loads(job.strains)["plate_mm"])
