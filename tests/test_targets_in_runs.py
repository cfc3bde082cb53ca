"""Runs on the virtual rig with calibration targets other than the line grid give the right strains."""

from typing import get_args

import pytest

import dic
from dic.correlation.settings import CorrelationSettings
from dic.pipeline.run import process_run
from dic.runfile.reader import RunFile
from dic.targets.kinds import CharucoTarget
from rig.protocol.grid import AnyGrid
from rig.run import run_protocol
from tests.dic.targets.drawings import asymmetric_dots, charuco, checkerboard, dots
from tests.places import example, small_cameras

LINES = "lines_x = 21\nlines_y = 21\npitch_mm = 0.5\n"
CHARUCO = CharucoTarget((9, 7), 1.2, 0.9, "DICT_5X5_100")

TARGETS = {
    "checkerboard": (
        'target = "checkerboard"\nsquares_x = 12\nsquares_y = 11\npitch_mm = 0.9\n',
        checkerboard((12, 11), 0.9),
        110,
    ),
    "charuco": (
        'target = "charuco"\nsquares_x = 9\nsquares_y = 7\npitch_mm = 1.2\nmarker_mm = 0.9\n',
        charuco(CHARUCO),
        48,
    ),
    "dots": ('target = "dots"\ndots_x = 13\ndots_y = 13\npitch_mm = 0.8\n', dots((13, 13), 0.8, 0.2), 169),
    "asymmetric-dots": (
        'target = "asymmetric-dots"\ndots_x = 7\ndots_y = 13\npitch_mm = 1.4\n',
        asymmetric_dots((7, 13), 1.4, 0.25),
        91,
    ),
}


MARKS = {
    "checkerboard": pytest.mark.extended,
    "dots": pytest.mark.extended,
    "asymmetric-dots": pytest.mark.long,
}
"""A ChArUco board has most settings, and stands in the first part for all targets but the line grid."""


@pytest.mark.parametrize("kind", [pytest.param(kind, marks=MARKS.get(kind, [])) for kind in TARGETS])
def test_the_target_of_the_protocol_calibrates_the_run(tmp_path, monkeypatch, kind):
    table, texture, points = TARGETS[kind]
    # the simulated operator attaches this target instead of the line grid
    monkeypatch.setattr("simulators.scene.scene.LineGrid", lambda: texture)
    protocol, rig_path, path = tmp_path / "p.toml", tmp_path / "r.toml", tmp_path / "run.h5"
    turn = ("increment_deg = 22.5", "increment_deg = 10.0"), ("total_deg = 360.0", "total_deg = 10.0")
    protocol.write_text(example("rotation", *turn, (LINES, table)))
    rig_path.write_text(example("rig-virtual-rotation-10", small_cameras(560, 1560.0)))
    assert run_protocol(protocol, rig_path, path).status == "completed"
    with RunFile(path) as run:
        assert run.grid_target == kind
    result = process_run(path, CorrelationSettings(step_px=40))
    for camera in result.cameras:
        assert len(camera.calibration.grid.xy_mm) == points
        (measurement,) = camera.measurements
        assert measurement.mean.rotation_deg == pytest.approx(10.0, abs=0.1)
        # the paper's false strain of the leaning axis, no more: the scale is that of the target
        assert abs(measurement.mean.exx) < 3e-3
        assert abs(measurement.mean.eyy) < 3e-3


def test_a_protocol_can_name_every_kind_of_target() -> None:
    tables = [get_args(table.model_fields["target"].annotation) for table in get_args(AnyGrid)]
    assert tables == [(name,) for name in dic.targets.TARGETS]
