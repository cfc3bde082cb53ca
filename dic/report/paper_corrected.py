"""Quantities of Helm and Deaner's paper, computed from strains corrected for out-of-plane motion."""

from collections.abc import Sequence
from functools import partial

import numpy as np

from dic.report.comparison import Entry, PaperComparison, means, turned_cameras, worst_text
from dic.report.series import CameraSeries, Run, difference
from dic.typing import Float

_MAY_BE = "not done; “a correction … may be possible” (conclusions)"


def corrected_tension(runs: Sequence[Run]) -> list[PaperComparison]:
    """Return comparisons of the strain error that remains in tension after the correction.

    The comparisons cover the correction by one camera and the correction by two cameras together.
    """
    along: list[Entry] = []
    across: list[Entry] = []
    together: list[Entry] = []
    for run in runs:
        on_axis = run.on_axis
        if run.kind != "tension" or on_axis is None:
            continue
        for camera in run.off_axis:
            others = [component for component in range(3) if component not in camera.swing]
            values = difference(camera.steps, camera.corrected, on_axis)[1]
            for entries, components in ((along, camera.swing), (across, others)):
                entries.append(Entry(run.number, camera.label, _corrected_means(values, components, camera)))
        if run.pair is not None and np.isfinite(run.pair.corrected).any():
            values = difference(run.pair.steps, run.pair.corrected, on_axis)[1]
            together.append(Entry(run.number, run.pair.label, means(values, range(3))))
    compared = partial(PaperComparison, test="tension", figure="corrected differences")
    return [
        compared(
            "difference of the corrected off-axis camera from the raw on-axis camera "
            "in the direction of the tilt, mean over the corrected steps",
            _MAY_BE,
            along,
        ),
        compared("the same difference of the other strains, corrected", _MAY_BE, across),
        compared(
            "the same difference of both cameras together, mean over the corrected steps",
            "not done",
            together,
        ),
    ]


def corrected_rotation(runs: Sequence[Run]) -> list[PaperComparison]:
    """Return comparisons of the strain error that remains in a rotation after the correction."""
    turned = turned_cameras(runs)
    return [
        PaperComparison(
            "largest strain error after correction",
            _MAY_BE,
            [
                Entry(c.run, c.label, _not_corrected(c) or worst_text(c, c.corrected, c.corrected_std))
                for c in turned
            ],
            "rotation",
            "corrected rotation",
        ),
    ]


def _corrected_means(values: Float, components: Sequence[int], camera: CameraSeries) -> str:
    if reason := _not_corrected(camera):
        return reason
    corrected, steps = camera.declined.count(None), len(camera.declined)
    some = f" ({corrected} of {steps} steps)" if corrected < steps else ""
    return means(values, components) + some


def _not_corrected(camera: CameraSeries) -> str:
    """Return the text "not corrected" if no step of the camera was corrected, else an empty text."""
    return "not corrected" if np.isnan(camera.corrected).all() else ""
