"""An acquisition from free-running cameras takes the nearest frames, and repeats bit by bit."""

import h5py
import numpy as np
import pytest

from simulators.rig.camera import FreeRunningCamera
from simulators.rig.camera_settings import CameraSettings
from simulators.scene.scene import Misalignment, Scene
from simulators.scene.specimen import SimulatedSpecimen, SpecimenSettings
from tests.rig.engine.test_acquisition import beside

SMALL = {"width_px": 32, "height_px": 24, "exposure_us": 8000.0}
BEATS = {"on_axis": {"fps": 25.0, "shift_us": 7000.0}, "off_axis": {"fps": 20.0}}


def recorded(tmp_path, name):
    (tmp_path / name).mkdir()
    rig = beside(tmp_path / name)
    specimen = SimulatedSpecimen(SpecimenSettings())
    scene = Scene(
        seed=1,
        misalignment=Misalignment(),
        specimen=specimen,
        angle_deg=lambda: 0.0,
        load_n=lambda: specimen.stretch_to(0.0),
    )
    rig.cameras = {
        name: FreeRunningCamera(name, CameraSettings(**SMALL | beat), scene, rig.clock)
        for name, beat in BEATS.items()
    }
    outcome = rig.engine().run()
    assert outcome.is_good, outcome.reason
    for camera in rig.cameras.values():
        camera.close()
    with h5py.File(rig.path) as file:
        due_s = file["entry/steps/due_s"][()]
        groups = {name: file[f"entry/instrument/{name}"] for name in BEATS}
        return due_s, {
            name: {key: group[key][()] for key in ("middle_s", "middle_std_s", "sequence", "data")}
            for name, group in groups.items()
        }


def test_each_image_is_the_frame_nearest_to_its_time_again_and_again(tmp_path):
    due_s, cameras = recorded(tmp_path, "first")
    for name, found in cameras.items():
        assert len(found["middle_s"]) == len(due_s) == 21
        assert np.abs(found["middle_s"] - due_s).max() <= 0.5 / BEATS[name]["fps"] + 1e-6
        number = (found["middle_s"] - 0.004 - BEATS[name].get("shift_us", 0.0) * 1e-6) * BEATS[name]["fps"]
        assert number == pytest.approx(found["sequence"], abs=1e-6)
        assert found["middle_std_s"].tolist() == [0.0] * 21
    _, again = recorded(tmp_path, "again")
    for name, found in cameras.items():
        for key, values in found.items():
            np.testing.assert_array_equal(again[name][key], values)
