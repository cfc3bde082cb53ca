"""Cameras prepared as a run file is processed: live strains of a run equal those of `dic process`."""

import numpy as np
import pytest

import dic
from dic.gauges import Extensometer, StrainGauge
from dic.live import LiveCamera, LiveHow, LiveSetups
from dic.out_of_plane.motion import Motion
from dic.pipeline import GridImages
from dic.runfile.joined import open_run
from tests.dic.pipeline.rendered_run import SMALL, slid, write_rendered_run

GAUGES = (
    Extensometer(name="axial", unit="mm", start=(0.3, -1.2), end=(0.3, 1.2), patch=0.6),
    StrainGauge(name="area", unit="mm", centre=(-0.3, 0.2), size=(1.5, 1.5), direction_deg=90.0),
)
SETTINGS = dic.CorrelationSettings(subset_px=31, step_px=10)


@pytest.mark.parametrize("plate_mm", [0.0, 1.0])
def test_live_strains_of_the_frames_of_a_run_equal_those_of_dic_process(tmp_path, plate_mm):
    path = write_rendered_run(
        tmp_path / "run.h5", [slid(0.01), slid(0.02), slid(0.03)], camera=SMALL, plate_mm=plate_mm
    )
    dic.process_run(path, SETTINGS, incremental="never", output=tmp_path / "results.h5")
    there = dic.measure_gauges(tmp_path / "results.h5", GAUGES).images
    with open_run(path) as run:
        reference, *steps = run.series()
        images = {"aside": run.image("aside", reference)}
        frames = [run.image("aside", step, stored=True) for step in steps]
    how = LiveHow(GAUGES, SETTINGS, Motion("tension"), plate_mm)
    setups = LiveSetups.of_run(images, GridImages.of_run(path).calibrations(), how)
    assert setups.pair is None
    camera = LiveCamera(setups.cameras["aside"])
    for k, (frame, offline) in enumerate(zip(frames, there, strict=True)):
        live = camera.measure(frame, 0.1 * k)
        for gauge in GAUGES:
            for kind in ("raw", "calibrated"):
                here, known = live[gauge.name].readings[kind], offline.readings[gauge.name][kind]
                assert np.isfinite(known.strain)
                assert here.strain == pytest.approx(known.strain, abs=1e-6)
                assert here.points == known.points


def test_a_camera_without_a_grid_measures_raw_strain(tmp_path):
    path = write_rendered_run(tmp_path / "run.h5", [slid(0.01)], camera=SMALL, has_grid=False)
    with open_run(path) as run:
        images = {"aside": run.image("aside", run.series()[0])}
    gauges = (StrainGauge(name="area", centre=(140, 140), size=(60, 60)),)
    setups = LiveSetups.of_run(images, {}, LiveHow(gauges, SETTINGS, Motion("tension")))
    assert setups.cameras["aside"].motion is None
    with pytest.raises(dic.MeasurementError, match="grid"):
        GridImages.of_run(path)
