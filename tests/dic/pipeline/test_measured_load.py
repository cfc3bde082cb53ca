"""Properties from loads measured beside a closed machine: the load's delay is a part of their error.

The strains are exact up to a noise of 10 µε, in place of those of images.
"""

from dataclasses import replace

import numpy as np
import pytest

from dic import material_properties
from dic.derived import gauge_curve
from dic.errors import GaugeError
from dic.gauges import GaugeImage, GaugeSeries, PointGauge, Reading, plot_gauges
from dic.gauges.channel import gauge_channels
from dic.properties import PropertySettings
from dic.runfile.at_exposure import steps_at_exposure
from dic.runfile.reader import RunFile
from dic.runfile.steps import ChannelValue
from tests.dic.records.timed_tests import AREA_MM2
from tests.dic.runfile.closed_machine import closed_test, write_test

POINT = PointGauge(name="point", at=(1, 1))
NOISE = 1e-5


def series_of(path, test, seed, clip=None):
    """Return the gauges of a run; `clip` gives the value of a clip-on extensometer for each strain."""
    with RunFile(write_test(path, test)) as run:
        steps = steps_at_exposure(run)["front"].steps
    path.unlink()
    strain = test.strain + NOISE * np.random.default_rng([seed, 7]).normal(size=len(test.strain))
    if clip is not None:
        steps = [
            replace(step, channels=(clip(e),)) for step, e in zip(steps, test.strain.tolist(), strict=True)
        ]
    images = tuple(
        GaugeImage(f"step {step.index}", {"point": {"raw": Reading("px", strain=e)}}, step.known())
        for step, e in zip(steps, strain.tolist(), strict=True)
    )
    return GaugeSeries("run.results.h5", (POINT,), images, channels=gauge_channels(steps))


def judged(series, gauge="point"):
    read = gauge_curve(series, gauge)
    return read.judged(material_properties(read.curve, PropertySettings(AREA_MM2)))


def test_the_delay_of_the_load_is_part_of_the_error_of_the_strength(tmp_path):
    parts, stds = {}, {}
    for delay_std_s in (0.001, 0.1):
        test = closed_test(0, delay_std_s=delay_std_s, length_s=20.0)
        found = judged(series_of(tmp_path / "r.h5", test, 0))
        parts[delay_std_s] = found.delay_parts["Rp02_mpa"]
        stds[delay_std_s] = found.values["Rp02_mpa"].std
        assert found.as_dict()["std_by_delay"]["Rp02_mpa"] == parts[delay_std_s]
    # The clocks of box and camera, 2 ms and 1 ms, are uncertain as well.
    assert parts[0.1] / parts[0.001] == pytest.approx(0.1 / np.hypot(0.001, np.hypot(0.002, 0.001)), rel=0.5)
    assert stds[0.1] > parts[0.1] > 2.0 * stds[0.001]
    assert any("by the delay of the load: " in text and "Rp02 " in text for text in found.time_texts)


def test_the_strain_of_a_clip_on_extensometer_stands_beside_the_gauges(tmp_path):
    test = closed_test(1, length_s=20.0)
    series = series_of(tmp_path / "r.h5", test, 1, lambda e: ChannelValue("clip", "%", 100.0 * e, 1e-4, 1e-4))
    by_clip, by_images = judged(series, "channels.clip"), judged(series)
    assert gauge_curve(series, "channels.clip").kind == "measured"
    for found in (by_clip, by_images):
        e_gpa = found.values["E_gpa"]
        assert abs(e_gpa.value - test.e_gpa) < 3.5 * e_gpa.std
    assert by_clip.values["E_gpa"].std < by_images.values["E_gpa"].std
    assert plot_gauges(series, tmp_path / "both.svg", against="load") == []
    drawn = (tmp_path / "both.svg").read_text()
    assert "channels.clip, measured" in drawn
    assert plot_gauges(series, tmp_path / "by_clip.svg", against="channels.clip") == []
    assert "channels.clip, %" in (tmp_path / "by_clip.svg").read_text()
    series = series_of(tmp_path / "r.h5", test, 1, lambda e: ChannelValue("oven", "°C", 23.0))
    with pytest.raises(
        GaugeError, match=r"channels.oven: take its strain: expected a channel in one of 1, mm/mm"
    ):
        gauge_curve(series, "channels.oven")


@pytest.mark.long
def test_intervals_of_modulus_and_strength_hold_the_truth_for_100_specimens(tmp_path):
    z = []
    for seed in range(100):
        test = closed_test(seed, length_s=30.0, images=300, delay_std_s=0.02, noise_share=1e-2)
        found = judged(series_of(tmp_path / "r.h5", test, seed)).values
        pairs = (found["E_gpa"], test.e_gpa), (found["Rp02_mpa"], test.rp02_mpa)
        z.append([np.nan if v.value is None else (v.value - truth) / v.std for v, truth in pairs])
    z = np.array(z)
    inside = np.count_nonzero(np.abs(z) < 1.96, axis=0)
    rms = np.sqrt(np.nanmean(z**2, axis=0))
    print(f"E, Rp0.2: {inside} of 100 within, rms z {rms}, {np.isnan(z).sum(axis=0)} have no value")
    assert ((inside >= 90) & (inside <= 99)).all(), inside
    assert ((rms > 0.8) & (rms < 1.2)).all(), rms
