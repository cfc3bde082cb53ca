"""Runs that push a specimen: they end well, and buckling and wrong load cells are noticed."""

import tomllib
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from drivers.interfaces import LoadFrameLimits
from rig.protocol.protocol import parse_protocol
from rig.replay.replay import replay_run
from tests.rig.conftest import FakeLoadFrame, FakeRig
from tests.rig.engine.test_phases import readings_of, steps_of
from tests.rig.protocol.test_compression import BOTH, CYCLE, PUSH, PUSHING
from tests.rig.protocol.test_phases import text

# 17.8 kN/mm up to 8 kN in tension and in compression, and then 1 kN/mm
DISPLACEMENTS_MM = np.array([-10.0, -0.45, 0.0, 0.45, 10.0])
LOADS_N = np.array([-17500.0, -8000.0, 0.0, 8000.0, 17500.0])
QUICK = ("timeout_s = 60.0", "timeout_s = 60.0\npoll_s = 0.5")


class SymmetricFrame(FakeLoadFrame):
    """A load frame with a specimen that behaves alike in both directions, and with noise on its load cell.

    From the displacement `buckles_mm` on, the compressive load falls by `falls` of itself per mm.
    """

    buckles_mm = -np.inf
    falls = 0.0

    def read(self):
        state = super().read()
        load_n = float(np.interp(self.displacement_mm, DISPLACEMENTS_MM, LOADS_N))
        if self.displacement_mm < self.buckles_mm:
            at_n = float(np.interp(self.buckles_mm, DISPLACEMENTS_MM, LOADS_N))
            load_n = at_n * max(0.0, 1.0 - self.falls * (self.buckles_mm - self.displacement_mm))
        noise_n = 0.5 * np.sin(1e4 * state.sample)
        return replace(state, load_n=load_n * self.load_scale + noise_n)

    def go_to_load(self, load_n: float, rate_n_s: float) -> None:
        self.calls.append(f"load {load_n:g}")
        target_mm = float(np.interp(load_n / self.load_scale, LOADS_N, DISPLACEMENTS_MM))
        duration_s = abs(load_n - self.read().load_n) / rate_n_s
        self._go(target_mm, abs(target_mm - self.displacement_mm) / max(duration_s, 0.01))


def pushed(tmp_path, phases: str, tables: str = PUSHING) -> FakeRig:
    definition = text(phases, tables.replace(*QUICK))
    rig = FakeRig(parse_protocol(tomllib.loads(definition)), tmp_path / "run.h5", definition=definition)
    limits = LoadFrameLimits(-15000.0, 15000.0, -6.0, 6.0, 0.1, 2000.0)
    rig.load_frame = SymmetricFrame(rig.clock, rig.calls, limits=limits)
    return rig


def test_a_specimen_is_pressed_and_unloaded_and_the_replay_is_identical(tmp_path):
    rig = pushed(tmp_path, PUSH)
    outcome = rig.engine().run()
    assert (outcome.status, outcome.reason) == ("completed", "")
    steps = [(kind, target) for kind, target, _, _ in steps_of(rig)]
    assert steps[1:6] == [
        ("reference", -100.0),
        *(("load", load_n) for load_n in (-1100.0, -2100.0, -3100.0, -4000.0)),
    ]
    assert steps[-2:] == [("displacement", -1.0), ("load", 0.0)]
    loads_n = readings_of(rig)["load_n"]
    assert loads_n.min() == pytest.approx(-8550.0, abs=20.0)
    assert loads_n[-1] == pytest.approx(0.0, abs=20.0)
    replayed = replay_run(rig.path)
    assert (replayed.outcome.status, replayed.differences) == ("completed", [])


def test_buckling_ends_the_phase_that_waits_for_it_and_otherwise_the_run(tmp_path):
    # without the unloading, as this specimen would go back along the curve on which it buckled
    buckling = PUSH.partition('[[phases]]\ndo = "unload"')[0]
    rig = pushed(tmp_path, buckling)
    rig.load_frame.buckles_mm, rig.load_frame.falls = -0.3, 1.0
    outcome = rig.engine().run()
    assert outcome.status == "completed", outcome.reason
    [ended] = [event for event in rig.events() if event.startswith("the event of the phase has happened")]
    assert "the load is -51" in ended
    assert -0.36 < readings_of(rig)["displacement_mm"].min() < -0.32

    phases = buckling.replace('until = { load_drop = 0.03, if_never = "go-on" }\n', "")
    (tmp_path / "again").mkdir()
    rig = pushed(tmp_path / "again", phases)
    rig.load_frame.buckles_mm, rig.load_frame.falls = -0.3, 1.0
    outcome = rig.engine().run()
    assert outcome.status == "failed"
    assert "the specimen buckled, broke or slipped" in outcome.reason
    assert "raise limits.buckling_load_drop above 0.05" in outcome.reason
    assert readings_of(rig)["displacement_mm"].min() > -0.38


def test_a_fall_of_the_load_under_load_control_holds_the_machine(tmp_path):
    rig = pushed(tmp_path, PUSH)
    rig.load_frame.buckles_mm, rig.load_frame.falls = -0.1, 3.0
    outcome = rig.engine().run()
    assert outcome.status == "failed"
    assert "in compression" in outcome.reason or "buckled" in outcome.reason
    assert rig.calls[-1] == "hold"
    assert readings_of(rig)["displacement_mm"].min() > -0.16


def test_a_load_cell_that_shows_too_little_in_compression_is_noticed(tmp_path):
    rig = pushed(tmp_path, PUSH.split("[[phases]]", 2)[0] + "[[phases]]" + PUSH.split("[[phases]]")[2])
    rig.load_frame.load_scale = 0.02
    outcome = rig.engine().run()
    assert outcome.status == "failed"
    assert "in compression (here shown positive): expected" in outcome.reason
    # the specimen carries what the tension rules allow too, and not 4 kN / 0.02
    assert readings_of(rig)["load_n"].min() > -500.0


@pytest.mark.parametrize("first", ["", "high"])
def test_cycles_between_tension_and_compression(tmp_path, first):
    low, high = (-4000.0, 4000.0) if first else (-4000.0, -500.0)
    rig = pushed(tmp_path, CYCLE.format(low=low, high=high), BOTH)
    outcome = rig.engine().run()
    assert outcome.status == "completed", outcome.reason
    ends = [target for kind, target, _, _ in steps_of(rig) if kind == "load"]
    assert ends == [high, low] * 3
    loads_n = readings_of(rig)["load_n"]
    assert loads_n.min() == pytest.approx(low, abs=25.0)
    assert all(a != b for a, b in pairwise(ends))


def test_a_limit_of_compression_ends_the_run(tmp_path):
    rig = pushed(tmp_path, PUSH)
    rig.load_frame.on_read = lambda count, state: (
        replace(state, displacement_mm=-2.1) if rig.clock.now_s() > 60.0 else state
    )
    outcome = rig.engine().run()
    assert outcome.status == "failed"
    assert "a displacement of at least -2 mm" in outcome.reason
    assert "lower limits.displacement_min_mm below -2" in outcome.reason
