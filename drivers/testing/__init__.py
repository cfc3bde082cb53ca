"""Requirements for every driver, as tests that the driver's own test suite inherits.

::

    from drivers.testing import StageBench, StageContract

    class TestMyStage(StageContract):
        @pytest.fixture
        def bench(self):
            with my_simulator() as device:
                yield StageBench(open_my_stage(...), ...)

A bench holds the opened device, its clock, its limits, and handles that cause faults. A missing handle is
None; the tests that need this handle are reported as skipped.
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
