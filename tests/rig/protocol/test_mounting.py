"""The mounting of grid and specimen, as protocol and rig file declare it."""

import tomllib

import h5py
import numpy as np
import pytest
from pydantic import ValidationError

from drivers.errors import ConfigurationError
from rig.mounting import Mounting
from rig.protocol.protocol import parse_protocol, read_protocol
from rig.rigfile import read_rig
from rig.run import plan_protocol, run_protocol
from tests.places import example, small_cameras

DECLARED = '\n[mounting]\nplate_mm = 1\ntilt_axis_mm = [2.5, -30]\nshift_std_um = 4.0\nfixed_face = "back"\n'


def written(folder, name, text):
    path = folder / name
    path.write_text(text)
    return path


@pytest.mark.parametrize("name", ["tension", "creep"])
def test_every_test_with_a_load_frame_declares_its_mounting(name):
    mounting = parse_protocol(tomllib.loads(example(name) + DECLARED)).mounting
    assert mounting.plate_mm == 1.0
    assert mounting.hinge_mm == (2.5, -30.0)
    assert mounting.shift_std_um == 4.0
    assert mounting.fixed_face == "back"


def test_one_number_is_the_place_of_the_hinge_along_y():
    assert Mounting(tilt_axis_mm=-30.0).hinge_mm == (0.0, -30.0)
    assert Mounting().hinge_mm is None


def test_the_protocol_replaces_single_values_of_the_rig_file(tmp_path):
    rig = written(tmp_path, "rig.toml", example("rig-virtual-rotation-30") + DECLARED)
    protocol = written(tmp_path, "p.toml", example("tension") + "\n[mounting]\nplate_mm = 0.0\n")
    made = read_protocol(protocol).mounting.over(read_rig(rig).mounting)
    assert made == Mounting(plate_mm=0.0, tilt_axis_mm=[2.5, -30.0], shift_std_um=4.0, fixed_face="back")
    assert plan_protocol(protocol, rig).mounting == made


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("tilt_axis_mm = [1, 2, 3]", "[0, -30], got [1.0, 2.0, 3.0]"),
        ("tilt_axis_mm = 1e6", "at most 10000 mm away"),
        ("plate_mm = 1000", "mounting.plate_mm"),
        ("shift_std_um = -1", "mounting.shift_std_um"),
        ('fixed_face = "side"', "mounting.fixed_face"),
        ("plate_um = 1", "mounting.plate_um"),
    ],
)
def test_values_that_cannot_be_are_refused(tmp_path, line, words):
    for name, read in (("tension", read_protocol), ("rig-virtual-rotation-30", read_rig)):
        path = written(tmp_path, f"{name}.toml", f"{example(name)}\n[mounting]\n{line}\n")
        with pytest.raises(ConfigurationError) as caught:
            read(path)
        assert words in "\n".join(caught.value.mistakes)


def test_a_rotation_stage_has_no_hinge():
    with pytest.raises(ValidationError, match="a rotation stage has no grips"):
        parse_protocol(tomllib.loads(example("rotation") + "\n[mounting]\ntilt_axis_mm = -30\n"))


def test_a_run_records_the_mounting_that_both_files_declare(tmp_path):
    short = example("rotation", ("total_deg = 360.0", "total_deg = 22.5")) + "\n[mounting]\nplate_mm = 1.0\n"
    rig = example("rig-virtual-rotation-30", small_cameras(32, 100.0)) + "\n[mounting]\nshift_std_um = 4.0\n"
    protocol, rig_file = written(tmp_path, "p.toml", short), written(tmp_path, "r.toml", rig)
    assert run_protocol(protocol, rig_file, tmp_path / "run.h5").status == "completed"
    with h5py.File(tmp_path / "run.h5") as file:
        mounting = file["entry/mounting"]
        assert mounting["plate_mm"][()] == 1.0
        assert mounting["shift_std_um"][()] == 4.0
        assert np.isnan(mounting["tilt_axis_mm"][:]).all()
