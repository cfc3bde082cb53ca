"""Displacement fields as CSV, one file per image, a line per point of interest."""

import csv
from pathlib import Path

import numpy as np

from dic.correlation.field import Field
from dic.correlation.status import Status
from dic.strain.displacement import Displacement

_PIXELS = ["x_px", "y_px", "u_px", "v_px", "zncc", "status"]
_MILLIMETRES = ["X_mm", "Y_mm", "U_mm", "V_mm", "calibration"]


def write_csv(path: Path, field: Field, calibrated: Displacement | None) -> None:
    """Write the points of a field.

    Columns are x_px, y_px, u_px, v_px (image axes: x right, y down), zncc, status and, when calibrated, X_mm,
    Y_mm, U_mm, V_mm (grid axes: X right, Y up) and calibration: "inside", or "outside" where a value is an
    extrapolation. A point that failed has nan and the reason as its status.
    """
    active = field.active.ravel()
    rows = np.flatnonzero(active)
    points, u, v = field.points, field.u_px.ravel(), field.v_px.ravel()
    zncc, status = field.zncc.ravel(), field.status.ravel()
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(_PIXELS + (_MILLIMETRES if calibrated else []))
        if calibrated:
            position, vector = calibrated.position.reshape(-1, 2), calibrated.vector.reshape(-1, 2)
            valid = calibrated.valid.ravel()
        for k in rows:
            line = [f"{points[k, 0]:.0f}", f"{points[k, 1]:.0f}", f"{u[k]:.6f}", f"{v[k]:.6f}"]
            line += [f"{zncc[k]:.6f}", Status(status[k]).text]
            if calibrated:
                line += [f"{value:.7f}" for value in (*position[k], *vector[k])]
                line.append("inside" if valid[k] else "outside" if status[k] == Status.CONVERGED else "")
            writer.writerow(line)
