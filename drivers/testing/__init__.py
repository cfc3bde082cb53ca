"""What every driver must do, as tests that a driver's own test suite inherits.

::

    from drivers.testing import StageBench, StageContract

    class TestMyStage(StageContract):
        @pytest.fixture
        def bench(self):
            with my_simulator() as device:
                yield StageBench(open_my_stage(...), ...)

A bench is the opened device and what the tests need besides: its clock, its limits, and handles for what can
go wrong. A handle that a bench has not got is None; the tests that need it are skipped and say so.
"""

from drivers.testing.camera_bench import CameraBench
from drivers.testing.camera_contract import CameraContract
from drivers.testing.load_frame_contract import LoadFrameBench, LoadFrameContract
from drivers.testing.stage_contract import StageBench, StageContract

__all__ = [
    "CameraBench",
    "CameraContract",
    "LoadFrameBench",
    "LoadFrameContract",
    "StageBench",
    "StageContract",
]
