"""The settings that a stage reports are those in the stage, whatever the rig file says."""

from typing import Any

import pytest

from drivers.interfaces import RotationStage
from simulators.stage.device import StageDevice


def test_reports_what_the_stage_was_set_to_and_not_what_the_rig_file_says(
    stage: RotationStage, device: StageDevice
):
    scale = device.microsteps_per_deg
    device.limit_min, device.limit_max = round(-2 * scale), round(90 * scale)
    device.speed_microsteps_s, device.acceleration_microsteps_s2 = 3 * scale, 50 * scale
    found: dict[str, Any] = stage.read_settings()
    assert found["angle_min_deg"] == pytest.approx(-2.0)
    assert found["angle_max_deg"] == pytest.approx(90.0)
    assert found["speed_deg_s"] == pytest.approx(3.0, rel=1e-3)
    # a Zaber stage counts its acceleration in about 50 units here
    assert found["acceleration_deg_s2"] == pytest.approx(50.0, rel=0.01)
    assert found["firmware"] == stage.info.firmware


def test_reports_the_resolution(kit: Any, stage: RotationStage, device: StageDevice):
    found = stage.read_settings()
    if "encoder_step_deg" in found:
        assert found["encoder_step_deg"] == pytest.approx(1 / device.microsteps_per_deg, rel=1e-4)
    else:
        assert found["microsteps_per_turn"] == 360 * device.microsteps_per_deg
        assert found["microsteps_per_step"] == 64
