"""The report's findings on the set-up of a run: camera positions, sensitivities and uncertainties."""

import re

import numpy as np

from dic.calibration.calibration import Calibration
from dic.out_of_plane.diagnosis import Sensitivity
from dic.report.numbers import fixed, micro, with_std
from dic.report.series import CameraSeries, Run
from dic.report.strains import MICRO, plane_slopes
from dic.report.style import CONFIDENCE
from dic.report.tables import Remarks

_OPEN_SHARE = 0.05
"""Above this relative uncertainty of a camera's distance, the report asks for better data."""

_PERCENT = 100.0


def findings(run: Run) -> list[Remarks]:
    """Return the findings from each camera, the on-axis camera first, then from two cameras together."""
    corrections = run.result.corrections
    said = [(series.label, corrections.findings[series.camera]) for series in run.cameras]
    if run.pair is not None and corrections.joint is not None:
        said.append((run.pair.label, corrections.joint.findings))
    return [Remarks(label, [_sentence(text) for text in texts]) for label, texts in said if texts]


def camera_rows(run: Run) -> list[list[str]]:
    """Return the rows of the table of cameras, as text, one row per camera.

    The columns are: name; off-axis angle, degrees; coordinates X, Y, Z of the camera's centre in the grid's
    axes, mm; false strain per millidegree of tilt and per µm of shift, µε; 95 % uncertainty of the slopes
    (millidegrees) and of the corrected strain (µε) at the worst step.
    """
    return [[series.label, *_geometry(series.calibration), *_known(series)] for series in run.cameras]


def remaining(run: Run) -> list[str]:
    """Return sentences on the strain errors that a correction by one camera cannot remove, with numbers.

    Further sentences name the cameras whose distance from the grid is too uncertain.
    """
    sentences = []
    for series in run.cameras:
        sensitivity, pinhole = Sensitivity.of(series.calibration), series.calibration.pinhole
        if sensitivity is None or pinhole is None:
            problem = series.calibration.pinhole_problem
            sentences.append(f"{series.label}: nothing, as the camera's centre is not known ({problem}).")
            continue
        sentences.append(f"{series.label}: {_shift_text(run, MICRO * sensitivity.per_um)}")
        share = float(pinhole.centre_std_mm[2] / pinhole.centre_mm[2])
        if share > _OPEN_SHARE:
            sentences.append(
                f"{series.label}: its grid image leaves the camera's distance Cz open by "
                f"{_PERCENT * share:.0f} %, and with it w/Cz: give the focal length, the distance, "
                "or images of the grid tilted."
            )
    return sentences


def _geometry(calibration: Calibration) -> list[str]:
    pinhole, sensitivity = calibration.pinhole, Sensitivity.of(calibration)
    if pinhole is None or sensitivity is None:
        return ["–"] * 6
    centre = zip(pinhole.centre_mm, pinhole.centre_std_mm, strict=True)
    return [
        with_std(pinhole.off_axis_deg, pinhole.off_axis_std_deg),
        *(with_std(value, std) for value, std in centre),
        fixed(MICRO * sensitivity.per_mdeg, 1),
        fixed(MICRO * sensitivity.per_um, 1),
    ]


def _known(series: CameraSeries) -> list[str]:
    if not np.isfinite(series.corrected_std).any():
        return ["–", "–"]
    slopes_mdeg = 1000.0 * plane_slopes(series.corrections)[1]
    slopes = fixed(CONFIDENCE * float(np.nanmax(slopes_mdeg)), 1) if np.isfinite(slopes_mdeg).any() else "–"
    strain = micro(CONFIDENCE * float(np.nanmax(series.corrected_std)))
    return [f"± {slopes}", f"± {strain}"]


def _shift_text(run: Run, per_um: float) -> str:
    text = (
        f"a shift by w towards the camera strains all directions by w/Cz, {per_um:.1f} µε per µm, "
        f"which one camera cannot tell from strain. {_assumed_shift(run)}"
    )
    if run.pair is None or not np.isfinite(run.pair.shift_um).any():
        return text
    at = int(np.nanargmax(np.abs(run.pair.shift_um)))
    shift, std = run.pair.shift_um[at], run.pair.shift_std_um[at]
    return (
        f"{text} The joint solution measured the shift: at most {fixed(shift, 2)} ± {fixed(std, 2)} µm, "
        f"which makes {micro(per_um * shift)} ± {micro(per_um * std)} µε of this camera's corrected strain."
    )


def _assumed_shift(run: Run) -> str:
    if run.result.corrections.motion == "rigid":
        return "Corrected strain assumes no shift, because the specimen turns about a fixed axis."
    return f"The standard deviations assume this shift: {run.result.correcting.shift.text}."


def _sentence(text: str) -> str:
    return re.sub(r"(?<!\w)-(?=\d)", "−", f"{text[:1].upper()}{text[1:]}.")
