"""Correlate a pair with pyvale, as a job file says; runs in pyvale's own virtual environment."""

import json
import sys
import time
from pathlib import Path

import numpy as np
import pyvale.dic as dic
from PIL import Image


def main() -> None:
    job = json.loads(Path(sys.argv[1]).read_text())
    folder = Path(job["folder"])
    reference, deformed = (np.asarray(Image.open(folder / name)) for name in job["images"])
    # Points whose subset leaves the image are not compared.
    inside = np.zeros(reference.shape, bool)
    inside[job["margin"] : -job["margin"], job["margin"] : -job["margin"]] = True
    Image.fromarray(reference).save(folder / "pyvale_0.tif")
    Image.fromarray(deformed).save(folder / "pyvale_1.tif")
    wall, cpu = time.perf_counter(), time.process_time()
    dic.calculate_2d(
        reference=folder / "pyvale_0.tif",
        deformed=folder / "pyvale_1.tif",
        roi_mask=inside,
        seed=[reference.shape[1] // 2, reference.shape[0] // 2],
        subset_size=job["subset"],
        subset_step=job["step"],
        shape_function={"affine": "AFFINE", "quadratic": "QUAD"}[job["shape"]],
        max_displacement=16,
        num_threads=job["threads"],
        image_filter_kernel=5 if job["smooth"] else 1,
        output_basepath=str(folder),
        output_prefix="pyvale_result_",
        print_level=0,
    )
    wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    (table,) = folder.glob("pyvale_result_*.csv")
    found = np.loadtxt(table, delimiter=",", skiprows=1)
    table.unlink()
    np.savez(folder / job["result"], points=found[:, :2], moved=found[:, 2:4], wall_s=wall, cpu_s=cpu)


if __name__ == "__main__":
    main()
