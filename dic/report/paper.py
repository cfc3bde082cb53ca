"""The results of Helm and Deaner's paper, and the same quantities computed from the runs of a report."""

from collections.abc import Sequence
from functools import partial

import numpy as np

from dic.calibration.calibration import Model
from dic.calibration.residuals import Residuals
from dic.report.comparison import Entry, PaperComparison, means, turned_cameras, worst, worst_text
from dic.report.numbers import fixed
from dic.report.paper_corrected import corrected_rotation, corrected_tension
from dic.report.series import CameraSeries, Run, difference
from dic.typing import Float

_MODELS: tuple[tuple[Model, str, str], ...] = (
    (
        "bicubic",
        "residual of the off-axis camera's bicubic map at the grid points",
        "under 0.02 px up to 30°, computed for exact points (text, figure 2)",
    ),
    ("pinhole", "residual of a pinhole model of the same camera", "not done"),
)
_HALF_TURN_DEG = 180.0
_NEAR_DEG = 1.0


def compare(runs: Sequence[Run]) -> list[PaperComparison]:
    """Return the comparisons with Helm and Deaner's paper that are possible for the given runs."""
    return [
        row
        for row in (
            *_tension(runs),
            *corrected_tension(runs),
            _loading(runs),
            *_rotation(runs),
            *corrected_rotation(runs),
            *_calibration(runs),
        )
        if row.entries
    ]


def _tension(runs: Sequence[Run]) -> list[PaperComparison]:
    pulled = [(run, run.on_axis) for run in runs if run.kind == "tension" and run.on_axis is not None]
    change = [
        Entry(run.number, on_axis.label, means(np.abs(on_axis.calibrated - on_axis.raw), range(3)))
        for run, on_axis in pulled
    ]
    along, across, before = [], [], []
    for run, on_axis in pulled:
        for camera in run.off_axis:
            others = [component for component in range(3) if component not in camera.swing]
            raw = difference(camera.steps, camera.raw, on_axis)[1]
            calibrated = difference(camera.steps, camera.calibrated, on_axis)[1]
            along.append(Entry(run.number, camera.label, means(calibrated, camera.swing)))
            across.append(Entry(run.number, camera.label, means(calibrated, others)))
            before.append(Entry(run.number, camera.label, means(raw, camera.swing)))
    compared = partial(PaperComparison, test="tension", figure="differences")
    return [
        compared(
            "size of what calibration changes on the on-axis camera, mean over the steps",
            "less than 40 µε on average for all three strains (text, figures 18–20)",
            change,
        ),
        compared(
            "difference of the calibrated off-axis camera from the raw on-axis camera "
            "in the direction of the tilt, mean over the steps",
            "a bias of about 1000 µε at 30° (text, figures 18–20)",
            along,
        ),
        compared(
            "the same difference of the other strains",
            "comparable with the on-axis camera (text)",
            across,
        ),
        compared(
            "difference in the direction of the tilt before calibration",
            "larger than after calibration (text)",
            before,
        ),
    ]


def _rotation(runs: Sequence[Run]) -> list[PaperComparison]:
    turned = turned_cameras(runs)
    calibrated = partial(PaperComparison, test="rotation", figure="calibrated rotation")
    return [
        PaperComparison(
            "largest strain error before calibration",
            "155 000 µε at 30° (text, figures 21–23)",
            [Entry(c.run, c.label, worst_text(c, c.raw)) for c in turned],
            "rotation",
            "raw rotation",
        ),
        calibrated(
            "largest strain error after calibration",
            "4000 µε at 30°, at 180° of rotation, in the direction of the tilt (text, figure 24)",
            [Entry(c.run, c.label, worst_text(c, c.calibrated)) for c in turned],
        ),
        calibrated(
            "strain in the direction of the tilt after calibration, at 180°",
            "grows with the angle of the camera (text, figure 24)",
            [
                Entry(c.run, c.label, means(values, c.swing))
                for c in turned
                if len(values := _at_half_turn(c))
            ],
        ),
        calibrated(
            "largest error before calibration ÷ largest error after it",
            "approximately 40 at 30° (abstract)",
            [
                Entry(c.run, c.label, f"{worst(c.raw) / after:.0f}")
                for c in turned
                if (after := worst(c.calibrated)) > 0.0
            ],
        ),
    ]


def _loading(runs: Sequence[Run]) -> PaperComparison:
    entries = []
    for run in runs:
        loads = [step for step in run.steps if step.kind == "load"]
        stretches = [step for step in run.steps if step.kind == "displacement"]
        parts = []
        if loads:
            parts.append(f"{len(loads)} of load to {fixed(loads[-1].load_n / 1000, 2)} kN")
        if stretches:
            parts.append(f"{len(stretches)} of displacement to {fixed(stretches[-1].displacement_mm, 2)} mm")
        if parts:
            entries.append(Entry(run.number, "load frame", "; ".join(parts)))
    return PaperComparison(
        "increments",
        "of 2 kN until plastic deformation was evident, then of 0.3 mm to 5.00 mm of displacement (text)",
        entries,
        "tension",
        "load",
    )


def _calibration(runs: Sequence[Run]) -> list[PaperComparison]:
    return [
        PaperComparison(
            quantity,
            paper,
            [
                Entry(run.number, camera.label, _residual_text(camera.calibration.residuals[model]))
                for run in runs
                for camera in run.off_axis
                if model in camera.calibration.residuals
            ],
            "calibration",
            "residuals",
        )
        for model, quantity, paper in _MODELS
    ]


def _residual_text(residuals: Residuals) -> str:
    return f"rms {fixed(residuals.rms_px, 4)} px, largest {fixed(residuals.max_px, 4)} px"


def _at_half_turn(camera: CameraSeries) -> Float:
    at: Float = camera.calibrated[np.abs(camera.angles_deg - _HALF_TURN_DEG) <= _NEAR_DEG]
    return at
