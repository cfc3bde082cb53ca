"""Correlate a pair with SUN-DIC, as a job file says; runs in SUN-DIC's own virtual environment."""

import json
import shutil
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from sundic import sundic
from sundic.settings import Settings


def correlate(job: dict[str, Any], folder: Path) -> Any:
    settings = Settings()
    settings.ImageFolder = str(folder / "sundic")
    settings.DebugLevel = 0
    settings.CPUCount = job["threads"]
    settings.SubsetSize, settings.StepSize = job["subset"], job["step"]
    settings.ShapeFunctions = job["shape"].capitalize()
    settings.InterpolationOrder = job["order"]
    settings.GaussianBlurSize = 5 if job["smooth"] else 0
    settings.ConvergenceThreshold = 1e-3
    # With its default, SUN-DIC stops at a correlation of 0.999, before the iterations have converged.
    settings.NZCCThreshold = 1.0
    margin, (height, width) = job["margin"], job["size"]
    settings.ROI = [margin, margin, width - 2 * margin, height - 2 * margin]
    return sundic.planarDICLocal(settings, str(folder / "sundic.sdic"))[0]


def main() -> None:
    job = json.loads(Path(sys.argv[1]).read_text())
    folder = Path(job["folder"])
    (folder / "sundic").mkdir(exist_ok=True)
    for k, name in enumerate(job["images"]):
        shutil.copy(folder / name, folder / "sundic" / f"{k}.tif")
    step = job["step"]
    # The first call is not timed, because numba compiles the code during this call.
    job["step"] = 200
    correlate(job, folder)
    job["step"] = step
    wall, cpu = time.perf_counter(), time.process_time()
    found = correlate(job, folder)
    wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    ids = sundic.CompID
    points = np.stack([found[..., ids.XCoordID], found[..., ids.YCoordID]], axis=-1).reshape(-1, 2)
    moved = np.stack([found[..., ids.XDispID], found[..., ids.YDispID]], axis=-1).reshape(-1, 2)
    np.savez(folder / job["result"], points=points, moved=moved, wall_s=wall, cpu_s=cpu)


if __name__ == "__main__":
    main()
