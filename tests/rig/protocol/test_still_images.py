"""Still images after the reference: in the plan, in the run file, and in the results of `dic process`."""

import tomllib

import numpy as np
import pytest

from dic import CorrelationSettings, process_run
from dic.runfile.reader import RunFile
from rig.protocol.protocol import parse_protocol, recorded_protocol
from rig.run import run_protocol
from tests.places import example, small_cameras

IMAGES = "[images]\nstill = 0\n"


def steps_of(name, images):
    return parse_protocol(tomllib.loads(example(name, (IMAGES, images)))).steps()


def test_every_protocol_takes_still_images_between_the_reference_and_the_test():
    for name in ("tension", "rotation", "creep", "cycles"):
        steps = steps_of(name, "[images]\n")
        at = [step.index for step in steps if step.kind == "static"]
        assert at == [2, 3]
        assert steps[1].kind == "reference"
        assert [steps[k].at_s for k in at] == [5.0, 10.0]
    steps = steps_of("tension", "[images]\nstill = 3\nstill_every_s = 60.0\n")
    assert [step.at_s for step in steps if step.kind == "static"] == [60.0, 120.0, 180.0]
    assert "static" not in {step.kind for step in steps_of("tension", IMAGES)}


def test_runs_of_earlier_versions_go_on_without_still_images():
    definition = example("tension", (IMAGES, "[images]\n"))
    old = recorded_protocol(definition, ["grid", "reference", "load"])
    assert [step.kind for step in old.steps()[:3]] == ["grid", "reference", "load"]
    new = recorded_protocol(definition, ["grid", "reference", "static"])
    assert new.steps()[2].kind == "static"
    assert recorded_protocol(definition, ["grid", "reference"]).steps()[2].kind == "static"


@pytest.fixture(scope="module")
def run_file(tmp_path_factory):
    folder = tmp_path_factory.mktemp("still")
    edits = (IMAGES, "[images]\n"), ("total_mm = 5.0", "total_mm = 0.9")
    (folder / "p.toml").write_text(example("tension", *edits))
    (folder / "rig.toml").write_text(example("rig-virtual-tension", small_cameras(400, 1400.0)))
    assert run_protocol(folder / "p.toml", folder / "rig.toml", folder / "run.h5").status == "completed"
    return folder / "run.h5"


def test_a_run_file_has_the_still_images_as_steps(run_file):
    with RunFile(run_file) as run:
        assert [step.kind for step in run.steps[:5]] == ["grid", "reference", "static", "static", "load"]
        reference, first, second = run.steps[1:4]
        assert [first.time_s - reference.time_s, second.time_s - first.time_s] == pytest.approx([5, 5], abs=2)
        assert np.isfinite(run.image("off_axis", first)).all()


def test_the_standard_deviations_of_a_run_contain_what_its_still_images_show(run_file):
    result = process_run(run_file, CorrelationSettings(step_px=20))
    camera = result.cameras[0]
    assert [step.kind for step in camera.steps[:3]] == ["static", "static", "load"]
    findings = result.corrections.findings["off_axis"]
    assert any(finding.startswith("2 still images show") for finding in findings)
    for own in result.corrections.cameras.values():
        assert {"exx_std_still", "eyy_std_still"} <= set(own.images[2].uncertainty)
        assert own.images[0].uncertainty["exx_std_still"] == 0.0
