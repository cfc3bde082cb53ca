"""The direction of a specimen comes from the protocol through the run and its results into the campaign."""

import shutil
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

import dic
from dic.campaigns.campaign import SpecimenTest
from dic.commands.run_table import as_dict
from dic.errors import CurveError
from dic.gauges.series import GaugeSeries
from dic.report.conditions import _known
from dic.report.series import number_runs
from dic.report.tables import settings_rows
from dic.runfile.reader import RunFile
from tests.dic.pipeline import rendered_run
from tests.dic.pipeline.rendered_run import SMALL, slid, write_rendered_run
from tests.dic.report.runs import tension_run
from tests.run_files import HEADER, write_run

SETTINGS = dic.properties.PropertySettings(area_mm2=20.0)


def along(direction_deg: float | None):
    return replace(HEADER, sample=HEADER.sample.model_copy(update={"direction_deg": direction_deg}))


def test_a_run_file_states_the_direction_and_one_without_it_says_so(tmp_path):
    for number, direction_deg in enumerate((45.0, 0.0, None)):
        path = write_run(tmp_path / f"{number}.h5", header=along(direction_deg))
        with RunFile(path) as run:
            assert run.info.direction_deg == direction_deg
        with h5py.File(path) as file:
            stored = file["entry/sample/direction_deg"]
            assert stored.attrs["units"] == "deg"
            np.testing.assert_equal(stored[()], np.nan if direction_deg is None else direction_deg)


@pytest.mark.usefixtures("grids_found_once")
def test_the_result_file_keeps_the_direction(tmp_path, monkeypatch):
    monkeypatch.setattr(rendered_run, "HEADER", along(90.0))
    run = write_rendered_run(tmp_path / "run.h5", [slid(0.05)], camera=SMALL)
    dic.process_run(run, dic.CorrelationSettings(step_px=60), output=tmp_path / "result.h5")
    read = dic.pipeline.load_run_result(tmp_path / "result.h5")
    assert read.info.direction_deg == 90.0
    assert as_dict(read)["direction_deg"] == 90.0
    old = tmp_path / "old.h5"
    shutil.copy(tmp_path / "result.h5", old)
    old.chmod(0o600)
    with h5py.File(old, "r+") as file:
        del file["run"].attrs["direction_deg"]  # as in files of earlier versions
    assert dic.pipeline.load_run_result(old).info.direction_deg is None


def test_the_report_states_the_direction():
    result = tension_run(direction_deg=45.0)
    assert _known(result)["specimen"]["orientation"].text == "45° to the rolling direction"
    assert "orientation" not in _known(tension_run())["specimen"]
    assert dict(settings_rows(number_runs([result])[0]))["Direction"] == "45° to the rolling direction"


@pytest.fixture
def measured(monkeypatch):
    """Results whose name is their direction, with the curve of a short tensile test."""
    stress = np.concatenate([np.linspace(0, 400, 80), np.full(10, 400.0)])
    strain = np.concatenate([np.linspace(0, 0.002, 80), np.linspace(0.0021, 0.02, 10)])

    class Read:
        curve = dic.properties.Curve("one", 20 * stress, strain)
        kind, left_out = "raw", 0
        judged = staticmethod(lambda found: found)

    def series(file: Path, gauges, camera=None) -> GaugeSeries:
        stated = None if file.stem.startswith("none") else float(file.stem)
        return GaugeSeries(str(file), (), (), run=tension_run(direction_deg=stated).info)

    place = "dic.campaigns.specimen"
    gauge = type("Gauge", (), {"name": "whole"})()
    monkeypatch.setattr(f"{place}.whole_field_gauges", lambda file: [gauge, gauge])
    monkeypatch.setattr(f"{place}.measure_gauges", series)
    monkeypatch.setattr(f"{place}.gauge_curve", lambda *_, **__: Read)
    monkeypatch.setattr(f"{place}.file_sha256", lambda file: "0")


def specimen(name: str, direction_deg: float | None = None) -> dic.campaigns.CampaignSpecimen:
    source = dic.campaigns.GaugeChoice()
    return dic.campaigns.CampaignSpecimen(name, Path(f"{name}.h5"), SETTINGS, source, direction_deg)


@pytest.mark.usefixtures("measured")
def test_a_campaign_takes_the_directions_from_the_runs():
    campaign = dic.campaigns.measure_campaign([specimen("0"), specimen("45"), specimen("none", 90.0)])
    assert campaign.directions_deg == [0.0, 45.0, 90.0]
    assert [test.direction_deg for test in campaign.tests] == [0.0, 45.0, 90.0]


@pytest.mark.usefixtures("measured")
def test_directions_that_contradict_or_are_partly_known_are_told():
    campaign = dic.campaigns.measure_campaign([specimen("0", 0.0), specimen("45", 90.0)])
    [failed] = [test for test in campaign.tests if test.properties is None]
    assert isinstance(failed, SpecimenTest)
    assert "direction_deg: expected 45, which the run states, got 90" in str(failed.failure)
    with pytest.raises(CurveError, match="a direction of each specimen, or none, got none of none1"):
        dic.campaigns.measure_campaign([specimen("0"), specimen("none1")])
    with pytest.raises(CurveError, match="at least 0° and below 180°, got 200"):
        dic.campaigns.measure_campaign([specimen("200")])
    assert dic.campaigns.measure_campaign([specimen("none1"), specimen("none2")]).directions_deg == []
