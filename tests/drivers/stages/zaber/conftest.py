"""The tests of this folder use a Zaber stage."""

import pytest

from tests.drivers.stages.stage_kit import StageKit
from tests.drivers.stages.zaber.zaber_line import ZABER


@pytest.fixture
def kit() -> StageKit:
    return ZABER
