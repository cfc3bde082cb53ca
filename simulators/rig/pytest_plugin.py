"""The pytest fixture `virtual_rig`: a virtual rig for tests of programs that control a rig.

The fixture is available when offaxis is installed::

    def test_my_program_homes_the_stage(virtual_rig):
        my_program(virtual_rig.addresses["stage"])
        assert virtual_rig.stage.angle_deg() == 0.0

    @pytest.mark.virtual_rig(load_frame_map="scaled-integers", real_time=True)
    def test_my_program_gives_up_when_answers_are_lost(virtual_rig):
        virtual_rig.faults.switch_on("load_frame.drop")
        with pytest.raises(TimeoutError):
            my_program(virtual_rig.addresses["load_frame"])
"""

from collections.abc import Iterator
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from simulators.rig.virtual_rig import VirtualRig


def pytest_configure(config: pytest.Config) -> None:
    """Register the pytest mark `virtual_rig`."""
    config.addinivalue_line(
        "markers",
        "virtual_rig(**settings): settings of the fixture, as in the table [simulation] of a rig file",
    )


@pytest.fixture
def virtual_rig(request: pytest.FixtureRequest) -> "Iterator[VirtualRig]":
    """A `VirtualRig` for one test, with the attributes addresses, clock, scene, faults, stage and load_frame.

    The rig's time is simulated and advances only during a call of ``virtual_rig.clock.sleep``. With
    ``real_time=True`` in the mark of the test, the rig runs in real time.
    """
    from simulators.rig.virtual_rig import VirtualRig, VirtualRigSettings

    mark = request.node.get_closest_marker("virtual_rig")
    if mark is not None and mark.args:
        raise pytest.UsageError(f"virtual_rig: expected settings by name, such as seed=1, got {mark.args}")
    rig = VirtualRig(VirtualRigSettings.model_validate({} if mark is None else mark.kwargs))
    yield rig
    rig.close()
