import resource
import shutil
from collections import namedtuple
from pathlib import Path

import pytest

from rig.commands.plan import plan_lines
from rig.errors import ProtocolError
from rig.facts import RigFacts
from rig.plan import SECONDS_PER_IMAGE, make_plan, require_feasible
from rig.protocol.rotation import RotationProtocol
from rig.protocol.tension import TensionProtocol


@pytest.fixture
def tension_protocol(tension_table) -> TensionProtocol:
    return TensionProtocol.model_validate(tension_table)


@pytest.fixture
def rotation_protocol(rotation_table) -> RotationProtocol:
    return RotationProtocol.model_validate(rotation_table)


def test_duration_is_motion_and_dwell_of_all_steps(tension_protocol):
    # 10 kN at 200 N/s, 5 mm at 0.02 mm/s, and a dwell of 1 s in each of 24 steps.
    assert make_plan(tension_protocol).duration_s == pytest.approx(10000 / 200 + 5 / 0.02 + 24 * 1.0)


def test_cameras_add_their_images_and_bytes(rotation_protocol):
    plan = make_plan(rotation_protocol, RigFacts(cameras=2, image_bytes=2 * 900 * 900, speed_deg_s=10.0))
    assert plan.images == 36
    assert plan.size_bytes == 36 * 810_000
    assert plan.duration_s == pytest.approx(36.0 + 18 * 0.5 + 36 * SECONDS_PER_IMAGE)


def test_what_only_a_rig_knows_is_said_to_be_unknown(rotation_protocol):
    plan = make_plan(rotation_protocol)
    assert plan.duration_s is None
    assert plan.size_bytes is None
    assert "about unknown without the operator's time" in plan_lines(plan)[-1]


def test_plan_of_a_tension_test_says_what_the_specimen_decides(tension_protocol):
    text = "\n".join(plan_lines(make_plan(tension_protocol)))
    assert "24 steps at most" in text
    assert "worst load 13000 N, worst displacement 5.2 mm" in text
    assert text.count("if the specimen demands it") == 2 + 17


@pytest.mark.parametrize(
    ("facts", "objection"),
    [
        (RigFacts(has_load_frame=False), "a tension protocol needs a [load_frame]"),
        (RigFacts(load_max_n=12999.0), "limits.load_max_n is 13000, but the rig allows 12999 N at most"),
        (RigFacts(displacement_max_mm=5.1), "limits.displacement_max_mm is 5.2, but the rig allows 5.1 mm"),
        (RigFacts(speed_max_mm_s=0.01), "stretching.speed_mm_s is 0.02, but the rig allows 0.01 mm/s"),
        (RigFacts(load_rate_max_n_s=100.0), "loading.rate_n_s is 200, but the rig allows 100 N/s"),
    ],
)
def test_tension_beyond_the_rig_is_refused_before_anything_moves(tension_protocol, facts, objection):
    with pytest.raises(ProtocolError) as caught:
        require_feasible(make_plan(tension_protocol, facts), Path())
    assert objection in str(caught.value)


@pytest.mark.parametrize(
    ("facts", "objection"),
    [
        (RigFacts(has_stage=False), "a rotation protocol needs a [stage]"),
        (RigFacts(angle_max_deg=359.0), "rotation.total_deg is 360, but the rig allows 359 deg"),
        (RigFacts(angle_min_deg=1.0), "the reference is at 0 deg"),
        (
            RigFacts(speed_deg_s=0.1),
            "settle.timeout_s is 60, but a step and its dwell take 225.5 s",
        ),
    ],
)
def test_rotation_beyond_the_rig_is_refused_before_anything_moves(rotation_protocol, facts, objection):
    assert any(objection in found for found in make_plan(rotation_protocol, facts).objections)


def test_rig_that_is_just_enough_is_accepted(tension_protocol):
    facts = RigFacts(
        has_load_frame=True,
        load_max_n=13000.0,
        displacement_max_mm=5.2,
        speed_max_mm_s=0.02,
        load_rate_max_n_s=200.0,
    )
    plan = make_plan(tension_protocol, facts)
    require_feasible(plan, Path())
    assert list(plan.objections) == []


def test_disk_without_space_is_refused(tension_protocol, monkeypatch):
    usage = namedtuple("usage", "total used free")
    monkeypatch.setattr(shutil, "disk_usage", lambda path: usage(1e12, 1e12 - 5e6, 5_000_000))
    plan = make_plan(tension_protocol, RigFacts(cameras=2, image_bytes=1_000_000))
    with pytest.raises(ProtocolError, match=r"expected 26.4 MB of free space for the run, got 5.0 MB"):
        require_feasible(plan, Path())


def test_missing_folder_is_refused(rotation_protocol, tmp_path):
    with pytest.raises(ProtocolError, match="expected a folder for the run file"):
        require_feasible(make_plan(rotation_protocol), tmp_path / "nowhere")


def test_file_larger_than_the_process_may_write_is_refused(rotation_protocol, tmp_path):
    plan = make_plan(rotation_protocol, RigFacts(cameras=2, image_bytes=2_000_000))
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (5_000_000, before[1]))
    try:
        with pytest.raises(ProtocolError, match=r"no file above 5\.0 MB; raise the limit with `ulimit -f"):
            require_feasible(plan, tmp_path)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    require_feasible(plan, tmp_path)
