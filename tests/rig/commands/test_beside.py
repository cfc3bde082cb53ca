"""The commands of `rig` beside a closed machine: what they do there, and what they refuse."""

import json
from dataclasses import replace

import pytest

from drivers.channels.modbus import ModbusChannels
from tests.command_line import run_rig
from tests.rig.closed_rig import write_protocol, write_rig

STAGE = """[stage]
driver = "zaber-ascii"
port = "@stage"
angle_min_deg = -5.0
angle_max_deg = 365.0
[operator]"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_status_shows_the_measured_load(folder):
    done = run_rig("status", write_rig(folder), "--json", folder / "status.json")
    assert (done.status, done.err) == (0, "")
    assert done.out.startswith(
        "The load frame takes no commands, and nobody knows whether it moves; it shows "
    )
    assert abs(done.report["measured"]["load_n"]) < 30.0
    assert done.report["measured"]["displacement_mm"] is None
    assert done.report["silent"] == {}


def test_status_says_that_the_channel_does_not_answer(folder):
    done = run_rig("status", write_rig(folder, ('"@closed_machine"', '"127.0.0.1:1"')))
    assert done.status == 1
    assert "127.0.0.1:1" in done.err
    assert "The load frame does not answer" in done.out


@pytest.mark.parametrize(
    "arguments",
    [("hold",), ("unload", "--yes"), ("jog", "--load-n", "100", "--yes")],
    ids=lambda words: words[0],
)
def test_commands_to_the_machine_are_refused_in_one_sentence(folder, arguments):
    done = run_rig(arguments[0], write_rig(folder), *arguments[1:])
    assert done.status == 2
    assert done.err.count("\n") == 1
    assert "a load frame that takes commands" in done.err
    assert "emergency stop" in done.err


def test_hold_still_stops_the_stage(folder):
    done = run_rig("hold", write_rig(folder, ("[operator]", STAGE)))
    assert done.status == 0
    assert "a load frame that takes commands" in done.err
    assert "the stage stands at 0.00 deg" in done.out.casefold()


def test_jog_still_reads_the_stage(folder):
    done = run_rig("jog", write_rig(folder, ("[operator]", STAGE)), "--angle-deg", "1", "--yes")
    assert done.status == 1
    assert "home the stage first" in done.err


def test_plan_tells_the_number_of_images_and_their_size(folder):
    done = run_rig("plan", write_protocol(folder), "--rig", write_rig(folder), "--json", folder / "plan.json")
    assert (done.status, done.err) == (0, "")
    assert "0.5 s" in done.out
    assert "21 images" in done.out
    assert done.report["images"] == 21
    assert done.report["size_bytes"] == 21 * 64 * 48


def test_plan_of_an_unknown_number_tells_the_size_of_each_image_and_of_an_hour(folder):
    rig_file = write_rig(folder)
    ends = ("duration_s = 10", 'reaches = { channel = "channels.force", above = 9000 }')
    done = run_rig("plan", write_protocol(folder, ends), "--rig", rig_file, "--json", folder / "plan.json")
    assert done.status == 0
    assert done.report["images"] is None
    assert done.report["acquisition"]["images_per_hour"] == 7200
    assert done.report["acquisition"]["bytes_per_image"] == 64 * 48
    assert "the number of images is not known" in done.out
    assert f"{7200 * 64 * 48 / 1e6:.1f} MB per hour" in done.out
    events = ("every_s = 0.5", 'increment = { channel = "channels.force", by = 100 }')
    done = run_rig("plan", write_protocol(folder, ends, events), "--rig", rig_file)
    assert "per hour" not in done.out
    assert "0.00307 MB per image of all cameras" in done.out


def test_plan_of_a_ring_needs_the_space_of_its_last_seconds(folder):
    kept = ("every_s = 0.5", "every_s = 0.5\nkeep_s = 60")
    long = ("duration_s = 10", "duration_s = 86400")
    plan = folder / "plan.json"
    done = run_rig("plan", write_protocol(folder, kept, long), "--rig", write_rig(folder), "--json", plan)
    assert done.status == 0
    assert done.report["size_bytes"] == pytest.approx(122 * 64 * 48, rel=0.02)
    assert "the last 60 s are kept" in done.out


def test_plan_refuses_a_signal_that_the_rig_does_not_have(folder):
    ends = ("duration_s = 10", 'reaches = { channel = "channels.froce", above = 9000 }')
    done = run_rig("plan", write_protocol(folder, ends), "--rig", write_rig(folder))
    assert done.status == 1
    assert "the protocol needs channels.froce" in done.out


def test_lost_samples_end_a_completed_run_with_status_1(folder, monkeypatch):
    read = ModbusChannels.read
    monkeypatch.setattr(
        ModbusChannels, "read", lambda box, s: replace(found := read(box, s), first=2 * found.first)
    )
    done = run_rig("run", write_protocol(folder), "--rig", write_rig(folder), "--json", folder / "run.json")
    lost = done.report["lost_samples"]["box"]
    assert (done.status, done.report["status"]) == (1, "completed")
    assert lost > 400
    assert done.report["shortfalls"] == [
        f"channels.box: {lost} samples were lost; use a faster line, or ask for a lower rate"
    ]
    assert done.report["shortfalls"][0] in done.err


@pytest.fixture
def recorded(folder):
    """A run beside the machine, whose files are in the folder."""
    done = run_rig("run", write_protocol(folder), "--rig", write_rig(folder), "--json", folder / "run.json")
    assert done.status == 0, done.err
    return done


def test_a_run_is_recorded_and_good(folder, recorded):
    assert "21 steps in beside.h5" in recorded.out
    assert "takes no commands" in recorded.out
    report = recorded.report
    assert report["timing"]["taken"] == 21
    assert report["timing"]["late"] == report["timing"]["missing"] == 0
    assert report["at_end"]["measured"]["load_n"] > 100.0
    verified = run_rig("verify", "beside.h5", "--json", folder / "verified.json")
    assert (verified.status, verified.err) == (0, "")
    assert verified.report["channels"]["box"]["lost"] == 0
    assert run_rig("repair", "beside.h5").out == "nothing to repair\n"


def test_replay_and_continue_are_refused_in_one_sentence(folder, recorded):
    replayed = run_rig("replay", "beside.h5")
    assert replayed.status == 2
    assert replayed.err.count("\n") == 1
    assert "a run whose steps were commanded" in replayed.err
    again = run_rig("run", "beside.toml", "--rig", "rig.toml", "--continue", "beside.h5")
    assert again.status == 2
    assert "a completed one" in again.err


def test_an_aborted_acquisition_is_not_continued(folder):
    rig_file = write_rig(folder, ("range = [-50000, 50000]", "range = [-500, 500]"))
    protocol = write_protocol(folder)
    done = run_rig("run", protocol, "--rig", rig_file)
    assert done.status == 1
    assert "force within -500 to 500 N" in done.err
    again = run_rig("run", protocol, "--rig", rig_file, "--continue", "beside.h5")
    assert again.status == 2
    assert "images at times or events; begin a new run" in again.err


def test_events_tell_images_seldom(folder, recorded):
    events = [json.loads(line) for line in (folder / "beside.events.jsonl").read_text().splitlines()]
    assert sum(event["event"] == "step" for event in events) < 8
