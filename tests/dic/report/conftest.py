"""Reports that several test modules read."""

import numpy as np
import pytest

from dic.correlation.status import Status
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


@pytest.fixture(scope="session")
def tension_html(tmp_path_factory: pytest.TempPathFactory) -> str:
    return written(tmp_path_factory.mktemp("tension"), tension_run())


@pytest.fixture(scope="session")
def corrected_html(tmp_path_factory: pytest.TempPathFactory) -> str:
    return written(tmp_path_factory.mktemp("corrected"), corrected_tension_run())


@pytest.fixture(scope="session")
def troubled_html(tmp_path_factory: pytest.TempPathFactory) -> str:
    """The report of an aborted run with malicious texts, in which each camera has lost one step."""
    reason = f"the grips opened {EVIL}"
    run = tension_run(title=EVIL, sample=EVIL, definition=EVIL, status="aborted", status_reason=reason)
    off_axis, on_axis = run.cameras
    del off_axis.steps[1], off_axis.measurements[1]
    off_axis.failures.append(f"off_axis, step 3: nothing correlates {EVIL}")
    lost = on_axis.measurements[0].field
    lost.status[:] = Status.NOT_CONVERGED
    lost.warps[:] = np.nan
    on_axis.measurements[0] = measure(lost, on_axis.calibration, label="step 2")
    return written(tmp_path_factory.mktemp("troubled"), given(run, "free", {}))


@pytest.fixture(scope="session")
def rotation_html(tmp_path_factory: pytest.TempPathFactory) -> str:
    runs = [rotation_run(10.0, 0.0012), corrected_rotation_run(30.0, 0.004, simulated=True)]
    return written(tmp_path_factory.mktemp("rotation"), *runs)
