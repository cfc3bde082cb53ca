"""Live gauges as signals of a reading, and as samples of the run file."""

import numpy as np

from dic.runfile.reader import RunFile
from rig.commands.verify_channels import check_channels
from rig.live.signals import (
    RECORDED,
    LiveSamples,
    channels_record,
    signal_readings,
    signals_of,
)
from rig.live.values import CAUSES, GaugeValue, LiveReading
from rig.protocol.live_table import LiveTable
from rig.recorder import Recorder
from tests.run_files import CAMERAS, HEADER, START

TABLE = LiveTable(gauges=["a=point at=1,1", "b=point at=9,9"])


def value(strain, cause="", std=1e-5):
    return GaugeValue(strain, std, not cause, cause and f"because of {cause}", "raw", "left", cause)


READINGS = [
    LiveReading(1.0, 1e-3, 1.01, {"left": 7}, {"a": value(1e-3), "b": value(np.nan, "no_frame", np.nan)}),
    LiveReading(2.0, 2e-3, 2.01, {"left": 8}, {"a": value(5e-2, "jump"), "b": value(np.nan, "old", np.inf)}),
    LiveReading(3.0, 1e-3, 3.01, {"left": 9}, {"a": value(3e-3), "b": value(np.nan, "jump", np.nan)}),
]


def test_only_valid_values_are_samples_of_a_signal():
    assert [(signal.name, signal.unit) for signal in signals_of(TABLE)] == [
        ("gauge.a", "1"),
        ("gauge.b", "1"),
    ]
    found = signal_readings(TABLE, READINGS)
    assert set(found) == {"gauge.a"}
    assert found["gauge.a"].values.tolist() == [1e-3, 3e-3]
    assert found["gauge.a"].time_s.tolist() == [1.0, 3.0]
    assert (found["gauge.a"].newest, found["gauge.a"].is_new, found["gauge.a"].unit) == (3e-3, True, "1")
    assert signal_readings(TABLE, []) == {}


def test_the_run_file_has_all_values_and_why_some_are_not_valid(tmp_path):
    record, samples = channels_record(TABLE), LiveSamples(TABLE)
    recorder = Recorder(tmp_path / "run.h5", HEADER, CAMERAS, channels={RECORDED: record})
    assert samples.of([]) is None
    recorder.samples(RECORDED, samples.of(READINGS[:1]))
    recorder.samples(RECORDED, samples.of(READINGS[1:]))
    recorder.close("completed", "", START)
    with RunFile(tmp_path / "run.h5") as run:
        columns = run.columns(f"channels/{RECORDED}")
        problems = []
        check = check_channels(run, problems)[RECORDED]
    assert (problems, check.samples, check.lost, check.outside) == ([], 3, 0, 0)
    np.testing.assert_array_equal(columns["value_gauge.a"], [1e-3, np.nan, 3e-3])
    np.testing.assert_array_equal(columns["value_gauge.a.all"], [1e-3, 5e-2, 3e-3])
    np.testing.assert_array_equal(columns["value_gauge.a.std"], [1e-5] * 3)
    causes = [CAUSES[int(number)] for number in columns["value_gauge.a.cause"]]
    assert causes == ["", "jump", ""]
    assert np.isnan(columns["value_gauge.b"]).all()
    assert np.isnan(columns["value_gauge.b.std"]).all()
    assert [CAUSES[int(number)] for number in columns["value_gauge.b.cause"]] == ["no_frame", "old", "jump"]
    assert columns["time_s"].tolist() == [1.0, 2.0, 3.0]
    assert np.isnan(columns["device_s"]).all()
    np.testing.assert_allclose(columns["value_gauge_latency"], [0.01] * 3)
    assert columns["number"].tolist() == [0, 1, 2]


def test_causes_are_the_reasons_of_the_measurement():
    from dic.live import Reason

    assert CAUSES[0] == ""
    assert {reason.name.lower() for reason in Reason if reason} | {"no_frame", ""} == set(CAUSES)
