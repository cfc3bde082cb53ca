"""With random faults on every line, no call hangs, no wrong value is accepted, and no command is repeated.

In each round, the device stands still, and one to three random faults of its line are switched on. Then the
device is read, perhaps moved, and perhaps stopped, and the faults are cleared. Each reading of a standing
device must be true. Each error must be a `DeviceError`. After the faults are cleared, the device must be
usable again.
"""

import random
from collections.abc import Callable
from functools import partial
from typing import Any

import pytest

from drivers.clock import VirtualClock
from drivers.errors import DeviceError
from drivers.testing.common import assert_says_all
from tests.drivers.load_frames.test_contract import LINES as FRAME_LINES, Machine, opened
from tests.drivers.stages.test_contract import LINES as STAGE_LINES, bench_on

ROUNDS = 40
FAULTS = ("lose-request", "drop", "corrupt", "split", "duplicate", "late", "stale")


def trouble(rng: random.Random, panel: Any) -> None:
    for _ in range(rng.randint(1, 3)):
        panel.switch_on(f"{rng.choice(FAULTS)}:{rng.randint(1, 3)}")


def tried(call: Callable[[], Any]) -> Any:
    """Return the result of a call, or None after an error whose message is complete."""
    try:
        return call()
    except DeviceError as error:
        assert_says_all(error)
        return None


def stand(read: Callable[[], Any], clock: VirtualClock) -> Any:
    for _ in range(2000):
        state = read()
        if not state.moving:
            return state
        clock.sleep(0.1)
    raise AssertionError("it never stood")


@pytest.mark.long
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("line", STAGE_LINES)
def test_a_stage_in_trouble(line, seed):
    rng = random.Random(seed)
    with bench_on(line) as bench:
        bench.home()
        for _ in range(ROUNDS):
            standing = stand(bench.stage.read, bench.clock)
            commanded, motions = 0, bench.motions()
            trouble(rng, bench.panel)
            state = tried(bench.stage.read)
            if state is not None:
                assert (state.angle_deg, state.moving) == (standing.angle_deg, False)
            if rng.random() < 0.5:
                commanded = 1
                target_deg = float(rng.randint(0, 360))
                tried(partial(bench.stage.move_to, target_deg))
            if rng.random() < 0.3:
                tried(bench.stage.stop)
            bench.panel.clear()
            assert bench.motions() - motions <= commanded
            tried(bench.stage.read)
            if tried(bench.stage.read) is None:
                bench.home()


@pytest.mark.long
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("line", FRAME_LINES)
def test_a_frame_in_trouble(line, seed):
    rng = random.Random(seed)
    serve, url, map_name = FRAME_LINES[line]
    machine = Machine(map_name)
    server = serve(machine.device, registers=machine.registers, faults=machine.panel)
    try:
        with opened(machine, url.format(server.address), map_name, 0.1) as bench:
            for _ in range(ROUNDS):
                bench.load_frame.hold()
                standing = stand(bench.load_frame.read, bench.clock)
                commanded, motions = 0, machine.motions
                trouble(rng, machine.panel)
                state = tried(bench.load_frame.read)
                if state is not None:
                    assert (state.load_n, state.displacement_mm) == (
                        standing.load_n,
                        standing.displacement_mm,
                    )
                if rng.random() < 0.5:
                    commanded = 1
                    target_mm = rng.uniform(0.0, 1.0)
                    tried(partial(bench.load_frame.go_to_displacement, target_mm, 0.5))
                if rng.random() < 0.3:
                    tried(bench.load_frame.hold)
                machine.panel.clear()
                assert machine.motions - motions <= commanded
                tried(bench.load_frame.read)
    finally:
        server.close()
