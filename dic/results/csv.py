"""Tables of the points of interest as CSV: one file per image, one line per point."""

import csv

import numpy as np

from dic.correlation.status import Status
from dic.errors import MEASURE_FIRST, require_kind
from dic.files.writing import replacing
from dic.strain.measurement import Measurement
from dic.strain.strain import IMAGES_KEYS, STRAIN_KEYS
from dic.typing import PathLike

_PIXELS = ["x_px", "y_px", "u_px", "v_px", "zncc", "status"]
_MILLIMETRES = ["X_mm", "Y_mm", "U_mm", "V_mm", "calibration"]


def write_csv(measurement: Measurement, path: PathLike) -> None:
    """Write the points of interest of a measurement as a CSV table.

    The first columns are x_px, y_px, u_px, v_px (image axes: x right, y down), zncc and status. If there is a
    calibration, the columns X_mm, Y_mm, U_mm, V_mm (grid axes: X right, Y up) and calibration follow. The
    column calibration holds "inside", or "outside" if the calibrated values are extrapolated. The last
    columns hold the local strains (without a unit), the direction of the first principal strain in degrees,
    and the standard deviations of the strains and of the direction. For calibrated strain, exx_std_images …
    are the parts of the standard deviations that the images cause. The column local_strain is empty if the
    point has a local strain, and holds the reason otherwise. If the correlation of a point failed, the status
    of the point gives the reason, and the results of the point are nan.
    """
    require_kind("measurement", measurement, Measurement, MEASURE_FIRST)
    field, calibrated, strain = measurement.field, measurement.calibrated, measurement.strain
    points, u, v = field.points, field.u_px.ravel(), field.v_px.ravel()
    zncc, status = field.zncc.ravel(), field.status.ravel()
    names = [*STRAIN_KEYS, *(name for name in IMAGES_KEYS if getattr(strain, name) is not None)]
    strains = np.stack([getattr(strain, name).ravel() for name in names], axis=-1)
    reasons = measurement.strain_reasons.ravel()
    with replacing(path) as partial, partial.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow([*_PIXELS, *(_MILLIMETRES if calibrated else []), *names, "local_strain"])
        if calibrated:
            position, vector = calibrated.position.reshape(-1, 2), calibrated.vector.reshape(-1, 2)
            valid = calibrated.valid.ravel()
        for k in np.flatnonzero(field.active):
            line = [f"{points[k, 0]:.0f}", f"{points[k, 1]:.0f}", f"{u[k]:.6f}", f"{v[k]:.6f}"]
            line += [f"{zncc[k]:.6f}", Status(status[k]).text]
            if calibrated:
                line += [f"{value:.7f}" for value in (*position[k], *vector[k])]
                line.append("inside" if valid[k] else "outside" if status[k] == Status.CONVERGED else "")
            line += [f"{value:.9f}" for value in strains[k]]
            writer.writerow([*line, reasons[k]])
