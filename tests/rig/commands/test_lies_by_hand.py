"""`rig unload` and `rig jog`, while the load cell reads wrong values. The virtual rig knows the true load."""

import random
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from rig.commands.by_hand import move
from rig.commands.hand_plan import Wish
from rig.engine.manual import Moved
from simulators.rig.virtual_rig import VirtualRig
from tests.rig.commands.test_by_hand import RIG_FILE
from tests.rig.limits.lies import MATERIALS, Case, draw

LIES = ("zero-load", "tenth-load", "reversed-load", "stuck-load")
LOADED_N = 5000.0
TARGET_N = 4000.0
NOISE_N = 10.0
"""Tolerance in N: five standard deviations of the simulated load cell."""


@dataclass
class Machine:
    """A virtual rig for one motion by hand, whose specimen carries a load before the motion begins."""

    path: Path
    loaded_n: float = 0.0
    lie: str = ""
    lies_when: Callable[[float], bool] = lambda true_n: False
    lies_before: bool = False
    rigs: list[VirtualRig] = field(default_factory=list)
    truth_n: list[float] = field(default_factory=list)

    def opened(self, rig: VirtualRig) -> None:
        """Load the specimen of a rig that was just opened."""
        self.rigs.append(rig)
        frame = rig.load_frame
        frame.go_to_load(self.loaded_n, 500.0)
        beat = 0
        while frame.read().moving:
            beat += 1
            frame.beat(beat)
            rig.clock.sleep(0.1)
        frame.hold()
        if self.lies_before:
            rig.faults.switch_on(f"load_frame.{self.lie}")

    def on_reading(self, _reading: object) -> None:
        """Record the true load, and switch the wrong load reading on when `lies_when` is true."""
        true_n = self.rigs[0].load_frame.load_n()
        self.truth_n.append(true_n)
        if self.lie and not self.rigs[0].faults.active and self.lies_when(true_n):
            self.rigs[0].faults.switch_on(f"load_frame.{self.lie}")

    def moved(self, wish: Wish) -> Moved:
        """Execute one motion, and return its result."""
        done = move(self.path, wish, lambda motion, reading: None, self.on_reading)
        self.truth_n.append(self.rigs[0].load_frame.load_n())
        return done


@pytest.fixture
def machine(tmp_path, monkeypatch) -> Iterator[Machine]:
    path = tmp_path / "rig.toml"
    path.write_text(RIG_FILE)
    monkeypatch.chdir(tmp_path)
    made = Machine(path)
    build = VirtualRig.__init__

    def built(rig: VirtualRig, *args, **kwargs) -> None:
        build(rig, *args, **kwargs)
        made.opened(rig)

    monkeypatch.setattr(VirtualRig, "__init__", built)
    return made


def require_stopped(machine: Machine, done: Moved) -> None:
    assert done.status == "failed"
    assert "the load cell" in done.reason
    assert done.unsafe == ()
    assert machine.rigs[0].load_frame.executed[-1][1] == "hold"


@pytest.mark.parametrize("lie", LIES)
def test_a_load_cell_that_begins_to_lie_ends_an_unload(machine, lie):
    machine.loaded_n, machine.lie, machine.lies_when = LOADED_N, lie, lambda true_n: true_n < 3000.0
    require_stopped(machine, machine.moved(Wish("load", 0.0)))
    assert max(machine.truth_n) < LOADED_N + NOISE_N
    assert machine.truth_n[-1] > 0.0


@pytest.mark.parametrize("lie", ["reversed-load", "stuck-load"])
def test_a_load_cell_that_lied_before_an_unload_ends_it_without_an_overload(machine, lie):
    machine.loaded_n, machine.lie, machine.lies_before = LOADED_N, lie, True
    done = machine.moved(Wish("load", 0.0))
    assert done.status == "failed"
    # 5 % of the motion, the noise, and one reading at the greatest speed of this motion
    assert max(machine.truth_n) < 1.1 * LOADED_N


@pytest.mark.parametrize("lie", LIES)
@pytest.mark.parametrize("wish", [Wish("load", TARGET_N), Wish("displacement", 1.0)])
def test_a_load_cell_that_begins_to_lie_ends_a_jog(machine, wish, lie):
    machine.lie, machine.lies_when = lie, lambda true_n: true_n > 1500.0
    require_stopped(machine, machine.moved(wish))
    assert max(machine.truth_n) < 1500.0 + 0.2 * TARGET_N


@pytest.mark.parametrize("lie", ["zero-load", "reversed-load", "stuck-load"])
@pytest.mark.parametrize("wish", [Wish("load", TARGET_N), Wish("displacement", 1.0)])
def test_a_load_cell_that_lied_before_a_jog_ends_it_early(machine, wish, lie):
    machine.lie, machine.lies_before = lie, True
    require_stopped(machine, machine.moved(wish))
    assert max(machine.truth_n) < 0.25 * TARGET_N


@pytest.mark.parametrize("loaded_n", [0.0, LOADED_N])
@pytest.mark.parametrize(
    "wish",
    [
        pytest.param(Wish("load", 0.0), marks=pytest.mark.extended),
        Wish("load", TARGET_N),
        pytest.param(Wish("load", 8000.0), marks=pytest.mark.extended),
        Wish("displacement", 0.1, relative=True),
        Wish("displacement", -0.1, relative=True),
    ],
)
def test_an_honest_load_cell_ends_no_motion(machine, loaded_n, wish):
    if loaded_n == 0.0 and wish.relative and wish.target < 0.0:
        wish = Wish("displacement", -0.1, relative=True, free=True)
    machine.loaded_n = loaded_n
    done = machine.moved(wish)
    assert (done.status, done.reason) == ("completed", "")


def drawn(machine: Machine, seed: int) -> tuple[random.Random, Case]:
    """Give the machine a random specimen and grips, declared in the rig file with an error of up to 25 %."""
    rng = random.Random(f"by hand {seed}")
    case = draw(rng)
    area_mm2 = case.width_mm * case.thickness_mm
    stiffness_n_mm = MATERIALS[case.material][0] * area_mm2 / case.length_mm
    declared = f"[limits]\nspecimen_stiffness_min_n_mm = {stiffness_n_mm / 1.25}\n"
    # A busy computer may take long to answer for the simulated machine.
    text = case.rig().replace("call_timeout_s = 45.0", "call_timeout_s = 9.0")
    text = text.replace("reply_timeout_s = 20.0", "reply_timeout_s = 2.0")
    machine.path.write_text(text.replace("[limits]\n", declared))
    return rng, case


@pytest.mark.long
@pytest.mark.parametrize("seed", range(30))
@pytest.mark.parametrize("kind", ["unload", "load", "displacement"])
def test_many_honest_motions(machine, seed, kind):
    _, case = drawn(machine, seed)
    loaded_n = 0.7 * case.yield_n
    machine.loaded_n = 0.0 if kind == "load" else loaded_n
    wishes = {
        "unload": Wish("load", 0.0),
        "load": Wish("load", loaded_n),
        "displacement": Wish("displacement", -0.2 * loaded_n * case.compliance_mm_n, relative=True),
    }
    done = machine.moved(wishes[kind])
    assert (done.status, done.reason) == ("completed", "")


@pytest.mark.long
@pytest.mark.parametrize("seed", range(30))
@pytest.mark.parametrize("lie", LIES)
@pytest.mark.parametrize("kind", ["unload", "load"])
def test_many_lies(machine, seed, kind, lie):
    rng, case = drawn(machine, seed)
    high_n = 0.7 * case.yield_n
    begins_n = rng.uniform(0.3, 0.9) * high_n
    machine.lie = lie
    if kind == "unload":
        machine.loaded_n, machine.lies_when = high_n, lambda true_n: true_n < begins_n
    else:
        machine.lies_when = lambda true_n: true_n > begins_n
    require_stopped(machine, machine.moved(Wish("load", 0.0 if kind == "unload" else high_n)))
    assert max(machine.truth_n) < 1.2 * high_n
