"""A block is pushed on a virtual rig until it buckles, with a question, a pause and a replay."""

import numpy as np
import pytest

from dic.runfile.reader import RunFile
from rig.commands.verify import verify_run
from rig.news.run_news import NewsOptions
from rig.replay.replay import replay_run
from rig.run import run_protocol
from simulators.scene.specimen import BUCKLED_MM, SimulatedSpecimen, SpecimenSettings
from tests.places import example

PROTOCOL = """
kind = "phases"
title = "a block is pushed"
[sample]
name = "block"
thickness_mm = 1.0
width_mm = 25.0
gauge_length_mm = 60.0
direction_deg = 45.0
[images]
still = 0
[[phases]]
do = "to-load"
load_n = -3000.0
rate_n_s = 100.0
images.every_n = 1000.0
[[phases]]
do = "ask"
text = "Has the lamp been turned?"
[[phases]]
do = "to-displacement"
displacement_mm = -0.9
speed_mm_s = 0.02
images.every_s = 5.0
until.load_drop = 0.1
[start]
tare_max_n = 50.0
[settle]
load_tolerance_n = 20.0
displacement_tolerance_mm = 0.002
dwell_s = 1.0
timeout_s = 60.0
[limits]
load_max_n = 2000.0
load_min_n = -9000.0
displacement_max_mm = 1.5
displacement_min_mm = -1.0
break_load_drop = 0.3
"""
BUCKLES_N = 4000.0


def test_a_specimen_buckles_and_carries_tension_afterwards():
    settings = SpecimenSettings(buckling_load_n=BUCKLES_N)
    specimen = SimulatedSpecimen(settings)
    buckled_mm = -BUCKLES_N * settings.elastic_mm_per_n
    assert specimen.stretch_to(0.5 * buckled_mm) == pytest.approx(-0.5 * BUCKLES_N)
    assert specimen.state.axial_strain < 0.0 < specimen.state.transverse_strain
    assert specimen.stretch_to(buckled_mm - BUCKLED_MM) == pytest.approx(-BUCKLES_N / np.e)
    assert specimen.stretch_to(0.1) > 0.0
    assert SimulatedSpecimen(SpecimenSettings()).stretch_to(-0.1) == 0.0


def test_a_block_is_pushed_until_it_buckles(tmp_path):
    camera = 'driver = "simulated-camera"'
    (tmp_path / "rig.toml").write_text(
        example(
            "rig-virtual-tension",
            (camera, f"{camera}\nwidth_px = 48\nheight_px = 32"),
            (
                "load_max_n = 14000.0",
                "load_max_n = 14000.0\nload_min_n = -9000.0\ndisplacement_min_mm = -2.0",
            ),
        )
        + f"\n[simulation.specimen]\nbuckling_load_n = {BUCKLES_N}\n"
    )
    (tmp_path / "push.toml").write_text(PROTOCOL)
    engines, counts = [], {"all": 0}

    def progress(moving: bool) -> None:
        counts["all"] += 1
        reading = engines[0].status.reading
        if "paused" not in counts and reading is not None and reading.load_n < -1500.0 and moving:
            counts["paused"] = counts["all"]
            assert engines[0].pause("a listener") == ""
        if counts["all"] == counts.get("paused", 0) + 200:
            engines[0].go_on("a listener")

    outcome = run_protocol(
        tmp_path / "push.toml",
        tmp_path / "rig.toml",
        tmp_path / "run.h5",
        on_progress=progress,
        news=NewsOptions(on_begin=engines.append),
    )
    assert (outcome.status, outcome.reason) == ("completed", "")
    assert outcome.pauses.count == 1
    loads_n = [record.reading.load_n for record in outcome.steps]
    assert loads_n[2:5] == pytest.approx([-1000.0, -2000.0, -3000.0], abs=25.0)
    assert -0.9 * BUCKLES_N < loads_n[-1] < -0.85 * BUCKLES_N
    with RunFile(tmp_path / "run.h5") as run:
        assert run.info.direction_deg == 45.0
        lowest_n = run.columns("instrument/load_frame")["load_n"].min()
        events = [message.decode() for message in run.columns("events")["message"]]
    assert lowest_n == pytest.approx(-BUCKLES_N, abs=25.0)
    assert any(event.startswith("the event of the phase has happened") for event in events)
    assert any(event.startswith('"done" by the operator after') for event in events)
    assert verify_run(tmp_path / "run.h5").problems == []
    replayed = replay_run(tmp_path / "run.h5")
    assert (replayed.outcome.status, replayed.differences) == ("completed", [])
    assert replayed.outcome.pauses == outcome.pauses
