"""How often `dic process` reads the steps of the result file that it has written, and what it reads."""

from collections import Counter

import pytest

import dic
from dic.results.fields import StoredFields
from tests.command_line import run_dic
from tests.dic.pipeline.rendered_run import SMALL, slid, write_rendered_run

pytestmark = pytest.mark.usefixtures("grids_found_once")


@pytest.mark.extended
def test_steps_of_a_written_run_are_read_for_the_table_and_for_the_problems(tmp_path, monkeypatch):
    run = write_rendered_run(
        tmp_path / "run.h5", [slid(0.05 * number) for number in range(1, 4)], camera=SMALL
    )
    read, field = Counter(), StoredFields.field

    def counted(self, k, **named):
        read[k] += 1
        return field(self, k, **named)

    monkeypatch.setattr(StoredFields, "field", counted)
    assert run_dic("process", run, "--step", 30, "-o", tmp_path / "r.h5").status == 0
    # The strains are computed from the fields in memory.
    assert read == {0: 2, 1: 2, 2: 2}


def test_raw_gradients_are_read_for_strain_from_shape_functions_only(tmp_path):
    run = write_rendered_run(tmp_path / "run.h5", [slid(0.05)], camera=SMALL)
    settings = dic.CorrelationSettings(step_px=30)
    for source in ("fit", "shape"):
        measured = dic.process_run(run, settings, dic.StrainSettings(source=source))
        raw = measured.cameras[0].measurements[0].raw
        assert (raw.gradient is not None) == (source == "shape")
