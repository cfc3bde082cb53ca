"""The settings of a stage or a load frame that each driver accepts and refuses."""

import pytest

from drivers.registry import driver_names, find_driver
from drivers.settings import Settings

SPECS = {name: spec for name in driver_names() if (spec := find_driver(name)).kind in ("stage", "load_frame")}


def test_the_drivers_of_the_documentation_are_there():
    assert {"zaber-ascii", "newport-esp301", "modbus-frame"} <= set(SPECS)


@pytest.mark.parametrize("name", SPECS)
def test_every_setting_is_described_and_has_its_unit_in_its_name(name):
    settings = SPECS[name].settings
    # some settings are those of all stages, and described there
    described = "\n".join(base.__doc__ or "" for base in settings.__mro__ if issubclass(base, Settings))
    for field, info in settings.model_fields.items():
        assert field in described, f"{field} is not described"
        if info.annotation is float:
            units = ("_deg", "_deg_s", "_s", "_mm", "_mm_s", "_n", "_n_s", "_per_deg")
            assert field.endswith(units), f"{field} has no unit"
