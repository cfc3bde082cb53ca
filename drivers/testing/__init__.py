"""Tests that every driver must pass. The test suite of a driver inherits these test classes.

::

    from drivers.testing import StageBench, StageContract

    class TestMyStage(StageContract):
        @pytest.fixture
        def bench(self):
            with my_simulator() as device:
                yield StageBench(open_my_stage(...), ...)

A bench is an object with the opened device, its clock, its limits, and functions that cause faults. If a
function of the bench is None, the tests that need this function are skipped.
"""

from drivers.testing.camera_bench import CameraBench
from drivers.testing.camera_contract import CameraContract
from drivers.testing.channels_contract import ChannelsBench, ChannelsContract
from drivers.testing.interlock_contract import InterlockBench, InterlockContract
from drivers.testing.load_frame_bench import LoadFrameBench
from drivers.testing.load_frame_contract import LoadFrameContract
from drivers.testing.stage_contract import StageBench, StageContract
from drivers.testing.trigger_contract import TriggerBench, TriggerContract

__all__ = [
    "CameraBench",
    "CameraContract",
    "ChannelsBench",
    "ChannelsContract",
    "InterlockBench",
    "InterlockContract",
    "LoadFrameBench",
    "LoadFrameContract",
    "StageBench",
    "StageContract",
    "TriggerBench",
    "TriggerContract",
]
