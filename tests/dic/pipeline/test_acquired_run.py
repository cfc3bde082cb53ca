"""Results of images beside a closed machine: channels, times, and what is printed of a long run."""

import csv
import json
import math
from dataclasses import replace

import numpy as np
import pytest

from dic.commands.run_output import problems
from dic.commands.run_table import as_dict, table
from dic.derived import to_pandas, write_run_tables
from dic.pipeline import ImageTiming, load_run_result, save_run_result
from dic.pipeline.correction_settings import kinds_of, motion_of
from dic.pipeline.result import RunResult
from dic.runfile.steps import ChannelValue, RunStep
from tests.dic.report.page import Page, written
from tests.dic.report.runs import INFO, camera, stretch, uncorrected

PROTOCOL = 'kind = "acquire"\n[acquire]\nevery_s = 0.5\ntolerance_s = 0.1\n'


def step(k, late_s=0.01, kind="acquired"):
    due_s = 0.5 * k
    oven = ChannelValue("oven", "°C", 20.0 + k, 0.25, 0.125)
    return RunStep(
        k + 1,
        kind,
        math.nan,
        100.0 * k,
        math.nan,
        math.nan,
        due_s + late_s,
        load_std_n=1.5,
        time_std_s=0.001,
        load_lag_n=0.5,
        due_s=due_s,
        late_s=late_s,
        channels=(oven, ChannelValue("clip", "1", 1e-3 * k)),
    )


def run_with(count, *, remarks=(), **info) -> RunResult:
    steps = [step(k, 0.3 if k == 3 else 0.01) for k in range(1, count + 1)]
    seen = camera("front", steps, [stretch(0.0, 1e-4 * k) for k in range(count)])
    seen = replace(seen, remarks=list(remarks))
    return uncorrected("runs/beside.h5", replace(INFO, definition=PROTOCOL, **info), [seen])


def test_channels_and_deviations_are_columns_of_the_table_of_strains(tmp_path):
    write_run_tables(run_with(3), tmp_path)
    with (tmp_path / "strain.csv").open(encoding="utf-8-sig") as file:
        first, *_ = csv.DictReader(file)
    expected = {"load_n": 100.0, "load_std_n": 1.5, "load_lag_n": 0.5, "time_s": 0.51, "due_s": 0.5}
    expected |= {
        "late_s": 0.01,
        "channel_oven_degC": 21.0,
        "channel_oven_std_degC": 0.25,
        "channel_clip": 1e-3,
    }
    assert {name: float(first[name]) for name in expected} == pytest.approx(expected)
    # What is not known has no column.
    assert not {"displacement_mm", "angle_deg", "channel_clip_std"} & first.keys()


def test_a_result_file_keeps_the_readings_of_more_steps_than_an_attribute_can_hold(tmp_path):
    result = run_with(3, remarks=["load: it ends early"])
    save_run_result(result, tmp_path / "r.h5")
    found = load_run_result(tmp_path / "r.h5")
    assert found.cameras[0].steps[0].known() == pytest.approx(step(1).known(), nan_ok=True)
    assert list(found.cameras[0].remarks) == ["load: it ends early"]
    frame = to_pandas(tmp_path / "r.h5")
    assert frame.attrs["units"]["channel_oven_degC"] == "°C"
    assert frame["channel_oven_degC"].unique().tolist() == [21.0, 22.0, 23.0]
    seen = found.cameras[0]
    many = replace(seen, steps=seen.steps * 2000, measurements=list(seen.measurements) * 2000, outcomes=())
    from h5py import File

    from dic.results.steps import read_steps, write_steps

    with File(tmp_path / "many.h5", "w") as file:
        write_steps(file.create_group("camera"), many.steps)
        assert len(read_steps(file["camera"])[0]) == 6000


def test_timing_counts_late_and_missing_images():
    steps = [step(k, 0.3 if k == 3 else 0.01) for k in (0, 1, 2, 3, 4, 7, 8)]
    # The images 5 and 6 were not taken, so that their numbers went to those after them.
    numbers = range(1, len(steps) + 1)
    steps = [replace(each, index=number) for each, number in zip(steps, numbers, strict=True)]
    found = ImageTiming.of(steps, PROTOCOL)
    assert (found.images, found.late, found.missing, found.tolerance_s) == (7, 1, 2, 0.1)
    assert (found.asked_interval_s, found.reached_interval_s) == pytest.approx((0.5, 0.5))
    assert (found.late_s, found.latest_s) == pytest.approx((0.01, 0.3))
    assert "1 of 7 more than 0.1 s late (median 0.01 s, latest 0.3 s), 2 missing" in found.text
    # Without the protocol, the interval follows from the due times, and the tolerance from the interval.
    alone = ImageTiming.of(steps)
    assert (alone.asked_interval_s, alone.tolerance_s, alone.late) == pytest.approx((0.5, 0.25, 1))
    # An image that could not be measured is not missing.
    assert ImageTiming.of([each for each in steps if each.index != 2], PROTOCOL).missing == 2
    assert ImageTiming.of([replace(each, late_s=math.nan) for each in steps]) is None
    uneven = [replace(each, due_s=10.0**k) for k, each in enumerate(steps)]
    assert (ImageTiming.of(uneven).asked_interval_s, ImageTiming.of(uneven).missing) == (None, None)
    assert ImageTiming.of(steps, "acquire = 3").asked_interval_s == pytest.approx(0.5)
    assert ImageTiming.of(steps, "not = TOML = at all").tolerance_s == pytest.approx(0.25)


def test_command_json_and_report_tell_the_timing_and_what_is_not_known(tmp_path):
    result = run_with(5, remarks=["channels.oven: its record does not cover the exposures of 1 of 5 steps"])
    lines = table(result)
    assert "images asked every 0.5 s, reached every 0.5 s in the median" in lines
    assert "timed images: 1 of 5 more than 0.1 s late (median 0.01 s, latest 0.3 s), 0 missing" in lines
    assert "channels.oven: its record does not cover" in lines
    content = as_dict(result)["cameras"]["front"]
    assert content["timing"]["late"] == 1
    assert content["remarks"] == list(result.cameras[0].remarks)
    assert content["steps"][0]["channel_oven_degC"] == 21.0
    assert content["steps"][0]["displacement_mm"] is None
    json.dumps(content)
    page = Page(written(tmp_path, result))
    assert "1 of 5 more than 0.1 s late" in page.text
    assert "oven, °C" in page.text
    assert "100.0 ± 1.5" in page.text


def test_of_a_long_run_only_the_ends_are_printed(capsys):
    result = run_with(80)
    lines = table(result).splitlines()
    assert sum(line.startswith("acquired ") for line in lines) == 40
    assert "  … 40 more of 80; --json and --csv have all …" in lines
    assert any(line.startswith("acquired 21 ") for line in lines)
    assert any(line.startswith("acquired 62 ") for line in lines)
    assert len(as_dict(result)["cameras"]["front"]["steps"]) == 80
    failed = replace(result.cameras[0], failures=[f"step {k}: no speckles" for k in range(500)])
    assert problems("run.h5", replace(result, cameras=[failed])) == 2
    told = capsys.readouterr().err.splitlines()
    assert len(told) == 31
    assert told[-1].endswith("and 470 more such sentences; --json has all")


def test_images_beside_a_machine_whose_load_is_known_are_those_of_a_tension_test():
    assert motion_of(kinds_of([step(1), step(2)])) == "tension"
    unknown = replace(step(1), load_n=math.nan)
    assert motion_of(kinds_of([unknown])) == "free"
    assert kinds_of([step(1, kind="rotation"), unknown]) == {"rotation", "acquired"}


def test_a_specimen_without_a_size_has_none_in_the_report(tmp_path):
    sizes = dict.fromkeys(("thickness_mm", "width_mm", "gauge_length_mm"), np.nan)
    page = Page(written(tmp_path, run_with(3, **sizes)))
    assert "not stated" in page.text
    assert "nan mm" not in page.text
