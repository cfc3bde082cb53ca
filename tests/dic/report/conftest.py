"""Reports that several test modules read. Writing one takes seconds, so all workers share them."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from dic.correlation.status import Status
from dic.pipeline.result import RunResult
from dic.strain.measurement import measure
from tests.dic.report.page import written
from tests.dic.report.runs import (
    EVIL,
    corrected_rotation_run,
    corrected_tension_run,
    given,
    rotation_run,
    tension_run,
)
from tests.made_once import made_once


def drawn_once(
    tmp_path_factory: pytest.TempPathFactory,
    name: str,
    runs: Callable[[], list[RunResult]],
    *,
    fields: bool = True,
) -> str:
    """Return the HTML of a report, without drawn pictures, that the first worker to need it has written."""

    def draw(folder: Path) -> None:
        (folder / "kept.html").write_text(
            written(folder, *runs(), fields=fields, drawn=False), encoding="utf-8"
        )

    return (made_once(tmp_path_factory, f"{name}-report", draw) / "kept.html").read_text(encoding="utf-8")


@pytest.fixture(scope="session")
def tension_html(tmp_path_factory: pytest.TempPathFactory) -> str:
    return drawn_once(tmp_path_factory, "tension", lambda: [tension_run()], fields=False)


@pytest.fixture(scope="session")
def corrected_html(tmp_path_factory: pytest.TempPathFactory) -> str:
    return drawn_once(tmp_path_factory, "corrected", lambda: [corrected_tension_run()], fields=False)


@pytest.fixture(scope="session")
def troubled_html(tmp_path_factory: pytest.TempPathFactory) -> str:
    """The report of an aborted run with malicious texts, in which each camera has lost one step."""
    return drawn_once(tmp_path_factory, "troubled", lambda: [troubled_run()])


def troubled_run() -> RunResult:
    reason = f"the grips opened {EVIL}"
    run = tension_run(title=EVIL, sample=EVIL, definition=EVIL, status="aborted", status_reason=reason)
    off_axis, on_axis = run.cameras
    del off_axis.steps[1], off_axis.measurements[1]
    off_axis.failures.append(f"off_axis, step 3: nothing correlates {EVIL}")
    lost = on_axis.measurements[0].field
    lost.status[:] = Status.NOT_CONVERGED
    lost.warps[:] = np.nan
    on_axis.measurements[0] = measure(lost, on_axis.calibration, label="step 2")
    return given(run, "free", {})


@pytest.fixture(scope="session")
def rotation_html(tmp_path_factory: pytest.TempPathFactory) -> str:
    return drawn_once(
        tmp_path_factory,
        "rotation",
        lambda: [rotation_run(10.0, 0.0012), corrected_rotation_run(30.0, 0.004, simulated=True)],
    )
