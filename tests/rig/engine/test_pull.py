"""A pull moves the load frame through its stages without a stop, by the strain of a live gauge if wanted."""

import tomllib
from dataclasses import dataclass, replace

import h5py
import numpy as np
import pytest

from drivers.errors import DeviceFault
from rig.commands.verify import verify_run
from rig.facts import RigFacts, objections
from rig.protocol.protocol import parse_protocol
from tests.rig.conftest import FakeLoadFrame, FakeRig
from tests.rig.engine.fake_live import FakeLive
from tests.rig.engine.fake_stream import StreamingCamera
from tests.rig.protocol.test_phases import PULLING, mistakes, text

GAUGE_MM = 50.0
LIVE = """
[live]
gauges = ["axial=extensometer unit=mm start=0,-3 end=0,3 patch=1"]
"""
SPEEDS = """
[[phases]]
do = "pull"
displacement_mm = 2.0
images.every_s = 0.5
[[phases.stages]]
stress_rate_mpa_s = 40.0
until.stress_mpa = 200.0
[[phases.stages]]
speed_mm_s = 0.02
until.displacement_mm = 1.0
[[phases.stages]]
speed_mm_s = 0.05
[[phases]]
do = "unload"
load_n = 100.0
rate_n_s = 500.0
"""
STRAIN = """
[[phases]]
do = "pull"
displacement_mm = 4.0
images.every_s = 0.5
[[phases.stages]]
strain_rate_s = 0.0005
gauge = "axial"
parallel_length_mm = 60.0
speed_max_mm_s = 0.1
until.strain = 0.01
"""


@dataclass
class SteeredLoadFrame(FakeLoadFrame):
    """A load frame whose speed can be changed; `speeds` are those of its motions, with their times."""

    def __post_init__(self) -> None:
        self.speeds: list[tuple[float, float]] = []
        self.way: list[tuple[float, float]] = []

    def read(self):
        state = super().read()
        self.way.append((state.time_s, state.displacement_mm))
        return state

    def _go(self, target_mm: float, speed_mm_s: float) -> None:
        super()._go(target_mm, speed_mm_s)
        self.speeds.append((self.clock.now_s(), speed_mm_s))

    def change_speed(self, speed_mm_s: float) -> None:
        if not self._path[3]:
            raise DeviceFault("frame", "change speed", "a motion", "standstill", "begin one")
        self._go(self._path[2], speed_mm_s)

    def displacement_at(self, time_s: float) -> float:
        times_s, way_mm = np.array(self.way).T
        return float(np.interp(time_s, times_s, way_mm))


def strain_of(displacement_mm: float) -> float:
    """A soft machine takes up three quarters of the motion up to 0.4 mm, and nothing afterwards."""
    elastic_mm = min(displacement_mm, 0.4)
    return (0.25 * elastic_mm + max(0.0, displacement_mm - 0.4)) / GAUGE_MM


def pulled(tmp_path, phases: str, tables: str = PULLING + LIVE) -> tuple[FakeRig, FakeLive]:
    rig = FakeRig(parse_protocol(tomllib.loads(text(phases, tables))), tmp_path / "run.h5")
    rig.cameras = {"on_axis": StreamingCamera(rig.clock)}
    rig.load_frame = SteeredLoadFrame(rig.clock, rig.calls)
    live = FakeLive(rig.clock, lambda time_s: strain_of(rig.load_frame.displacement_at(time_s)))
    return rig, live


def test_stages_follow_one_another_without_a_stop_and_later_phases_go_on(tmp_path):
    rig, _ = pulled(tmp_path, SPEEDS, PULLING)
    outcome = rig.engine().run()
    assert outcome.is_good, outcome.reason
    assert rig.calls.count("load 5000") == 1
    first, last = rig.calls.index("load 5000"), rig.calls.index("load 100")
    # the first speed is commanded as a motion, the second changes it; then the machine is held
    assert rig.calls[first:last].count("displacement 2.000000") == 1
    assert rig.calls[first + 1] == "displacement 2.000000"
    assert [speed for _, speed in rig.load_frame.speeds[1:3]] == [0.02, 0.05]
    with h5py.File(rig.path) as file:
        steps = file["entry/steps"]
        kinds = [kind.decode() for kind in steps["kind"][()]]
        assert kinds == ["grid", "reference", *["acquired"] * (len(kinds) - 3), "load"]
        assert list(steps["index"][()]) == sorted(set(steps["index"][()]))
        times_s = steps["time_s"][()][2:-1]
    assert np.diff(times_s) == pytest.approx(0.5, abs=0.051)
    # 5 s to 5 kN at 0.34 mm, 33 s to 1 mm and 20 s to 2 mm, with an image every 0.5 s
    assert len(times_s) == pytest.approx(2 * (5.0 + (1.0 - 0.34) / 0.02 + 20.0), abs=4)


def test_a_strain_rate_is_held_through_a_change_of_stiffness(tmp_path):
    rig, live = pulled(tmp_path, STRAIN)
    outcome = rig.engine(live=live).run()
    assert outcome.is_good, outcome.reason
    assert live.prepared == [{"on_axis"}]
    assert live.closed
    begun_s = rig.load_frame.speeds[0][0]
    seconds_s = np.arange(begun_s, rig.load_frame.way[-1][0], 1.0)
    strains = np.array([strain_of(rig.load_frame.displacement_at(time_s)) for time_s in seconds_s])
    yielding = strains > 0.004
    rates = np.diff(strains[yielding & (strains < 0.0098)])
    assert rates.mean() == pytest.approx(0.0005, rel=0.05)
    assert np.abs(rates - 0.0005).max() < 0.2 * 0.0005
    assert any("gauge.axial above 0.01 was reached" in event for event in rig.events())


@pytest.mark.parametrize("why", ["the lens is covered", "dead"])
def test_without_a_valid_strain_the_machine_is_held_within_two_frames(tmp_path, why):
    rig, live = pulled(tmp_path, STRAIN)
    bad_s = 25.0
    live.invalid = lambda time_s: why if time_s > bad_s else ""
    outcome = rig.engine(live=live).run()
    assert outcome.status == "failed"
    expected = "no new value" if why == "dead" else why
    assert "expected a valid strain of the gauge axial" in outcome.reason
    assert expected in outcome.reason
    times_s, way_mm = np.array(rig.load_frame.way).T
    stopped_s = times_s[np.searchsorted(way_mm, way_mm[-1])]
    first_bad_s = bad_s + 0.1
    assert bad_s < stopped_s <= first_bad_s + 2 * 0.1 + 0.02


def test_a_machine_may_wait_for_a_gauge_that_is_covered_for_a_moment(tmp_path):
    rig, live = pulled(tmp_path, STRAIN.replace("until.strain", "return_s = 5.0\nuntil.strain"))
    live.invalid = lambda time_s: "covered" if 25.0 < time_s < 27.0 else ""
    outcome = rig.engine(live=live).run()
    assert outcome.status == "completed", outcome.reason
    events = rig.events()
    assert any(
        "the machine is held, because the gauge axial is not valid: covered" in event for event in events
    )
    assert any("valid again after" in event for event in events)
    assert rig.calls.count("displacement 4.000000") == 2


def test_discontinuous_yielding_goes_over_to_the_speed_of_the_crosshead(tmp_path):
    rig, live = pulled(tmp_path, STRAIN.replace("until.strain = 0.01", "until.displacement_mm = 1.5"))
    frame = rig.load_frame
    frame.on_read = lambda count, state: (
        state if state.displacement_mm < 0.5 else replace(state, load_n=0.9 * state.load_n)
    )
    # the band of yielding passes beside the gauge
    live._strain = lambda time_s: strain_of(min(0.5, frame.displacement_at(time_s)))
    outcome = rig.engine(live=live).run()
    assert outcome.status == "completed", outcome.reason
    assert any("discontinuous yielding" in event for event in rig.events())
    assert frame.speeds[-1][1] == pytest.approx(0.0005 * 60.0)


def test_a_strain_beyond_its_limit_ends_the_run(tmp_path):
    rig, live = pulled(tmp_path, STRAIN, PULLING + LIVE + "strain_max = 0.003\n")
    outcome = rig.engine(live=live).run()
    assert outcome.status == "failed"
    assert "expected a strain of gauge.axial of at most 0.003" in outcome.reason
    assert strain_of(rig.load_frame.displacement_mm) < 0.0032


def test_a_load_frame_that_keeps_its_speed_is_refused_for_a_strain_rate_alone(tmp_path):
    (sentence,) = objections(pulled(tmp_path, STRAIN)[0].protocol, RigFacts(changes_speed=False))
    assert sentence.startswith("phase 1 (pull): strain_rate_s needs a load frame whose driver can change")
    for phases, able in ((STRAIN, True), (STRAIN, None), (SPEEDS, False)):
        protocol = parse_protocol(tomllib.loads(text(phases, PULLING + LIVE)))
        assert objections(protocol, RigFacts(changes_speed=able)) == []


def test_a_pause_that_comes_before_a_change_of_speed_is_no_fault(tmp_path):
    rig, live = pulled(tmp_path, STRAIN)
    engine = rig.engine(live=live)
    change, frame = rig.load_frame.change_speed, rig.load_frame
    done: list[str] = []

    def late(speed_mm_s: float) -> None:
        if len(frame.speeds) > 20 and not done:
            # the pause holds the machine from another thread
            done.append(engine.pause("a test"))
            frame.hold()
            engine.go_on("a test")
        change(speed_mm_s)

    frame.change_speed = late
    outcome = engine.run()
    assert done == [""]
    assert outcome.status == "completed", outcome.reason
    assert outcome.pauses.count == 1


def test_a_pause_holds_the_machine_and_the_stage_goes_on(tmp_path):
    rig, live = pulled(tmp_path, STRAIN)
    engine = rig.engine(live=live)
    asked: list[float] = []

    def look(status) -> None:
        now_s = rig.clock.now_s()
        if status.live is not None and now_s > 25.0 and not asked:
            asked.append(now_s)
            assert engine.pause("a test") == ""
        elif asked and now_s > asked[0] + 5.0 and engine.pause_requested:
            assert engine.go_on("a test") == ""

    rig.load_frame.on_read = lambda count, state: (look(engine.status), state)[1]
    outcome = engine.run()
    assert outcome.status == "completed", outcome.reason
    assert outcome.pauses.count == 1
    assert strain_of(rig.load_frame.displacement_mm) == pytest.approx(0.01, abs=2e-4)


def test_mistakes_in_stages_are_told_together(tmp_path):
    wrong = STRAIN.replace('gauge = "axial"', 'gauge = "lateral"').replace("4.0", "9.0")
    found = mistakes(tmp_path, wrong, PULLING + LIVE)
    assert "limits.displacement_max_mm must be at least" in found
    assert "a gauge of the table [live] is expected (axial), got 'lateral'" in found
    assert "exactly one of speed_mm_s" in mistakes(
        tmp_path, STRAIN.replace("strain_rate_s", "speed_mm_s = 1\nstrain_rate_s")
    )
    assert "until.load_n or until.stress_mpa is missing" in mistakes(
        tmp_path, SPEEDS.replace("until.stress_mpa = 200.0", "until.duration_s = 3.0")
    )


TWICE = """
[[phases]]
do = "pull"
displacement_mm = 1.0
images.every_s = 0.5
[[phases.stages]]
speed_mm_s = 0.05
[[phases]]
do = "hold"
keep = "displacement"
duration_s = 60.0
[[phases]]
do = "pull"
displacement_mm = 2.0
images.every_s = 0.5
[[phases.stages]]
speed_mm_s = 0.05
"""


@pytest.mark.parametrize("slow", [False, True])
def test_the_images_of_two_pulls_are_counted_together_and_none_is_missing_between(tmp_path, slow):
    rig, _ = pulled(tmp_path, TWICE, PULLING)
    if slow:
        rig.cameras = {"on_axis": StreamingCamera(rig.clock, period_s=0.6)}
    outcome = rig.engine().run()
    assert outcome.status == "completed", outcome.reason
    assert outcome.timing.asked == pytest.approx(82, abs=2)
    assert bool(outcome.timing.missing) is slow
    found = verify_run(rig.path).timing["on_axis"]
    # The file does not show an image that is missing at the very beginning or end.
    assert found.images == outcome.timing.taken
    assert found.missing == pytest.approx(outcome.timing.missing, abs=2 if slow else 0)
