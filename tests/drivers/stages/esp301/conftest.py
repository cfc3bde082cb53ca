"""The tests of this folder use a stage on a Newport ESP301."""

import pytest

from tests.drivers.stages.esp301.esp301_line import ESP301
from tests.drivers.stages.stage_kit import StageKit


@pytest.fixture
def kit() -> StageKit:
    return ESP301
