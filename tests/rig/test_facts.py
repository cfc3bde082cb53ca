"""The machine gets the narrower limits of rig and protocol, and enforces them itself."""

import tomllib
from dataclasses import replace
from types import SimpleNamespace

import pytest

from rig.devices import open_rig
from rig.facts import RigFacts, confirm, facts_of_file, narrowed, objections
from rig.protocol.phased import PhasesProtocol
from rig.protocol.protocol import RotationProtocol, TensionProtocol
from rig.rigfile import read_rig
from tests.places import example


def tension(load_max_n: float, displacement_max_mm: float) -> TensionProtocol:
    table = tomllib.loads(example("tension"))
    table["limits"] |= {"load_max_n": load_max_n, "displacement_max_mm": displacement_max_mm}
    return TensionProtocol.model_validate(table)


@pytest.fixture
def rig_file(tmp_path):
    path = tmp_path / "rig.toml"
    wide = "load_min_n = -20000.0\ndisplacement_min_mm = -0.5\nload_max_n = 14000.0"
    path.write_text(example("rig-virtual-tension", ("load_max_n = 14000.0", wide)))
    return read_rig(path)


def test_the_machine_itself_keeps_the_narrower_limits_of_rig_and_protocol(rig_file):
    with open_rig(narrowed(rig_file, tension(13000.0, 5.2))) as rig:
        held = rig.load_frame.limits
        machine = rig.load_frame._work.read(rig.load_frame._map.blocks.limits, "look")
    # protocol, protocol (both directions), rig, protocol
    assert (held.load_max_n, held.load_min_n) == (13000.0, -13000.0)
    assert (held.displacement_min_mm, held.displacement_max_mm) == (-0.5, 5.2)
    assert (machine["load_max"], machine["load_min"]) == (13000.0, -13000.0)
    assert (machine["displacement_min"], machine["displacement_max"]) == (-0.5, pytest.approx(5.2, abs=1e-6))


def test_a_wider_protocol_widens_nothing(rig_file):
    narrow = narrowed(rig_file, tension(50000.0, 60.0))
    assert narrow.load_frame.settings == rig_file.load_frame.settings


def test_a_rotation_leaves_the_limits_of_the_rig(rig_file):
    rotation = RotationProtocol.model_validate(tomllib.loads(example("rotation")))
    assert narrowed(rig_file, rotation) == rig_file


def test_motions_to_a_load_are_refused_in_one_sentence_if_the_load_frame_controls_only_displacements():
    without = RigFacts(load_rate_max_n_s=0.0, speed_max_mm_s=1.0)
    (sentence,) = objections(tension(13000.0, 5.2), without)
    assert sentence == (
        "loading.rate_n_s: a load frame that controls the load is needed, and that of this rig only moves to "
        "displacements; use motions to a displacement, or another rig"
    )
    phases = PhasesProtocol.model_validate(tomllib.loads(example("creep")))
    (sentence,) = objections(phases, without)
    assert sentence.startswith(
        "phase 1 (preload): rate_n_s, phase 2 (to-load): rate_n_s, phase 3 (hold): rate"
    )
    assert objections(tension(13000.0, 5.2), RigFacts(load_rate_max_n_s=1000.0)) == []


def test_whether_the_speed_of_a_motion_can_be_changed_is_known_before_and_after_opening(rig_file):
    before = facts_of_file(rig_file)
    assert before.changes_speed is True
    with open_rig(rig_file) as rig:
        assert confirm(replace(before, changes_speed=None), rig).changes_speed is True
        with_plain = replace(rig, load_frame=SimpleNamespace(limits=rig.load_frame.limits))
        assert confirm(before, with_plain).changes_speed is False


def test_motions_to_displacements_need_no_control_of_the_load():
    table = tomllib.loads(example("creep"))
    table["phases"] = [{"do": "to-displacement", "displacement_mm": 1.0, "speed_mm_s": 0.02}]
    phases = PhasesProtocol.model_validate(table)
    assert objections(phases, RigFacts(load_rate_max_n_s=0.0, speed_max_mm_s=1.0)) == []
