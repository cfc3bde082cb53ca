"""The output lines of Aravis and GenTL cameras pass the contract tests of trigger outputs."""

from collections.abc import Iterator
from contextlib import closing
from functools import partial
from typing import Any

import pytest

from drivers.cameras.aravis.library import AravisError
from drivers.clock import VirtualClock
from drivers.errors import DeviceFault
from drivers.interfaces import OpenContext
from drivers.testing import TriggerBench, TriggerContract
from tests.drivers.cameras.aravis import opening as aravis
from tests.drivers.cameras.fake_aravis import FakeLibrary
from tests.drivers.cameras.fake_gentl import FakeDevice, opened as gentl_opened

WIDTH_S = 0.05
FEATURES = {
    "LineSelector": "Line1",
    "LineMode": "Input",
    "LineSource": "Off",
    "UserOutputSelector": "UserOutput0",
    "UserOutputValue": False,
}
LINE = {"output": "Line2", "output_source": "UserOutput1", "pulse_ms": 1e3 * WIDTH_S}
FAKES: dict[str, tuple[Any, Any]] = {
    "aravis": (FakeLibrary, aravis.opened),
    "gentl": (FakeDevice, gentl_opened),
}


@pytest.mark.parametrize("name", FAKES)
class TestCameraLine(TriggerContract):
    @pytest.fixture
    def bench(self, name) -> Iterator[TriggerBench]:
        fake_of, opened = FAKES[name]
        clock = VirtualClock()
        clock.sleep(1.0)
        fake = fake_of(clock)
        fake.values |= FEATURES
        context = OpenContext("cameras.front", clock)
        open_camera = partial(opened, fake, context, **LINE)
        with closing(open_camera()) as camera:
            fake.switched.clear()

            def edges() -> list[tuple[float, bool]]:
                found, level = [], False
                for time_s, feature, on in fake.switched:
                    if feature == "UserOutputValue" and on != level:
                        found.append((time_s, on))
                        level = on
                return found

            def leave_on() -> Any:
                camera.close()
                fake.values["UserOutputValue"] = True
                fake.switched.append((clock.now_s(), "UserOutputValue", True))
                return open_camera()

            yield TriggerBench(
                camera,
                clock,
                edges,
                width_s=WIDTH_S,
                tolerance_s=1e-6,
                reopen=leave_on,
                lose_one_answer=lambda: setattr(fake, "losing", 1),
                restore=lambda: setattr(fake, "gone", False),
                unplug=lambda: setattr(fake, "gone", True),
                lose_writes=lambda: fake.keeps.update(UserOutputValue=False),
            )
            fake.gone, fake.keeps = False, {}

    def test_a_pulse_comes_during_a_grab(self, bench) -> None:
        """The pulse marks an exposure, so it must not wait until the image has come."""
        pulses = bench.begun
        grab = bench.trigger.grab
        bench.trigger.pulse()
        assert grab(1.0).flags == 0
        assert bench.begun == pulses + 1


class Stuck(FakeLibrary):
    """A camera whose line may be switched on, and refuses to be switched off."""

    refuses_off = False

    def camera_set_boolean(self, name: bytes, value: int) -> None:
        if self.refuses_off and not value:
            raise AravisError("Timeout")
        super().camera_set_boolean(name, value)


def test_a_line_that_does_not_end_its_pulse_is_told_by_the_next_one(clock):
    """An error that nobody waits for must not be lost."""
    library = Stuck(clock)
    library.values |= FEATURES
    with closing(aravis.opened(library, OpenContext("cameras.front", clock), **LINE)) as camera:
        library.refuses_off = True
        camera.pulse()
        clock.sleep(1.0)
        library.refuses_off = False
        with pytest.raises(DeviceFault, match=r"end the pulse before: .* after 0\.05 s.*longer"):
            camera.pulse()
