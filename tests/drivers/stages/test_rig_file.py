"""All mistakes in a stage's table of the rig file are reported together, before any device is opened."""

import pytest

from drivers.registry import find_driver
from drivers.stages.zaber.settings import ZaberSettings
from tests.mistakes import mistakes_of


@pytest.mark.parametrize(
    ("driver", "further", "mistakes"), [("zaber-ascii", {}, 3), ("newport-esp301", {"axis": 4}, 4)]
)
def test_mistakes_in_the_rig_file_are_reported_together(driver, further, mistakes):
    spec = find_driver(driver)
    table = {"port": 3, "angle_min_deg": 0.0, "angle_max_deg": float("nan"), "colour": "red"} | further
    assert len(mistakes_of(spec.settings, table)) == mistakes


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("microsteps_per_deg", 0.5),
        ("microsteps_per_deg", 1e30),
        ("speed_deg_s", 1e308),
        ("angle_min_deg", -1e300),
        ("angle_max_deg", 1e300),
    ],
)
def test_numbers_that_no_stage_can_mean_are_a_mistake(key, value):
    table = {"port": "/dev/ttyUSB0", "angle_min_deg": 0.0, "angle_max_deg": 9.0, key: value}
    (mistake,) = mistakes_of(ZaberSettings, table)
    assert mistake.startswith(key)


def test_crossed_limits_are_a_mistake():
    table = {"port": "/dev/ttyUSB0", "angle_min_deg": 10.0, "angle_max_deg": 0.0}
    (mistake,) = mistakes_of(ZaberSettings, table)
    assert "angle_min_deg must be below angle_max_deg" in mistake
