"""Correlate a pair with muDIC (finite elements as wide as a subset); runs in muDIC's own environment."""

import json
import logging
import sys
import time
from pathlib import Path

import muDIC
import numpy as np
from PIL import Image


def main() -> None:
    job = json.loads(Path(sys.argv[1]).read_text())
    folder = Path(job["folder"])
    logging.disable(logging.CRITICAL)
    images = [np.asarray(Image.open(folder / name), float) for name in job["images"]]
    (height, width), margin, subset = job["size"], job["margin"], job["subset"]
    wall, cpu = time.perf_counter(), time.process_time()
    stack = muDIC.image_stack_from_list(images)
    across, down = (width - 2 * margin) // subset, (height - 2 * margin) // subset
    mesh = muDIC.Mesher(type="q4").mesh(
        stack,
        Xc1=float(margin),
        Xc2=float(margin + across * subset),
        Yc1=float(margin),
        Yc2=float(margin + down * subset),
        n_elx=across,
        n_ely=down,
        GUI=False,
    )
    settings = muDIC.DICInput(mesh, stack, ref_update_frames=[], interpolation_order=job["order"], maxit=100)
    settings.tol = 1e-3
    found = muDIC.DICAnalysis(settings).run()
    wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    nodes = np.stack([found.xnodesT, found.ynodesT], axis=-1)
    np.savez(
        folder / job["result"], points=nodes[:, 0], moved=nodes[:, 1] - nodes[:, 0], wall_s=wall, cpu_s=cpu
    )


if __name__ == "__main__":
    main()
