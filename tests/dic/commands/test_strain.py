"""Tests of the strain options of `dic correlate`, and of the standard deviations in its files."""

import h5py
import numpy as np
import pytest

from dic.strain.strain import STRAIN_KEYS
from tests.command_line import refusal, run_dic
from tests.image_files import write_image


@pytest.fixture(scope="module")
def folder(speckle, tmp_path_factory):
    """A folder with ref.png, and with moved.png, which is stretched by the factor 1.02 along x."""
    folder = tmp_path_factory.mktemp("strain")
    pattern = speckle(seed=22, noise=1.0)
    for name, image in (
        ("ref", pattern.draw(noise_seed=1)),
        ("moved", pattern.draw(lambda x, y: (x / 1.02, y), noise_seed=2)),
    ):
        write_image(folder / f"{name}.png", image)
    return folder


def command(folder, *options):
    return ["correlate", folder / "ref.png", folder / "moved.png", "--subset", 21, "--step", 10, *options]


def _share_kept(source: str, period_px: float) -> float:
    """Return the share of its amplitude that a strain wave keeps, from integrals over a subset of 21 px.

    The slope of a line fitted over the half length h keeps ``3 (sin x − x cos x)/x³`` of a wave's slope, x =
    2π h/period. The displacement in the middle of a subset, fitted by a parabola with the weight ``9/8 − 15/8
    t²``, keeps the integral of weight times ``cos x t`` from −1 to 1. The slope through three points with the
    distance d keeps ``sin(k d)/(k d)``.
    """
    k = 2 * np.pi / period_px
    x = 10.5 * k
    if source == "shape":
        return 3 * (np.sin(x) - x * np.cos(x)) / x**3
    squares = 2 * (np.sin(x) / x + 2 * np.cos(x) / x**2 - 2 * np.sin(x) / x**3)
    displacement = 9 / 8 * 2 * np.sin(x) / x - 15 / 8 * squares
    return displacement * np.sin(10 * k) / (10 * k)


@pytest.mark.parametrize(
    ("measure", "exx"), [("green-lagrange", (1.02**2 - 1) / 2), ("hencky", np.log(1.02)), ("small", 0.02)]
)
@pytest.mark.parametrize(("source", "gauge_px"), [("fit", 41), ("shape", 21)])
def test_the_strain_that_was_asked_for_comes_with_its_deviation_and_gauge(
    folder, tmp_path, measure, exx, source, gauge_px
):
    options = ["--strain", measure, "--strain-from", source, "--strain-window", 3]
    outputs = ["--json", tmp_path / "r.json", "-o", tmp_path / "r.h5"]
    result = run_dic(*command(folder, *options, *outputs))
    assert result.status == 0, result
    assert f"virtual strain gauge {gauge_px} px" in result.out
    summary = result.report["images"][0]
    strain = summary["strain"]
    assert _share_kept(source, strain.pop("resolution_px")) == pytest.approx(0.9, abs=0.003)
    assert strain.pop("amplitude_lost") == {"exx": pytest.approx(0.0, abs=0.002), "eyy": None}
    assert strain == {
        "measure": measure, "window_points": 3, "source": source, "gauge_px": gauge_px, "gauge_mm": None,
    }  # fmt: skip
    assert 2e-6 < summary["raw"]["exx_std"] < 50e-6
    assert summary["raw"]["exx"] == pytest.approx(exx, abs=6 * summary["raw"]["exx_std"])
    assert summary["raw"]["e1"] == pytest.approx(exx, abs=6 * summary["raw"]["e1_std"])
    assert summary["raw"]["direction_deg"] == pytest.approx(0, abs=0.2)
    with h5py.File(tmp_path / "r.h5") as file:
        series = file["series"]
        assert series.attrs["strain_measure"] == measure
        assert series.attrs["strain_gauge_px"] == gauge_px
        for name in STRAIN_KEYS:
            assert series[name].attrs["units"] == ("deg" if "direction" in name else "1")
            assert series[f"raw_mean/{name}"][0] == summary["raw"][name]
        local, deviation = series["exx"][0], series["exx_std"][0]
        off = (local - exx)[np.isfinite(local)] / deviation[np.isfinite(local)]
        assert off.size > 80
        assert np.sqrt(np.mean(off**2)) == pytest.approx(1, abs=0.35)


@pytest.mark.parametrize(
    ("option", "value", "words"),
    [
        ("--strain", "true", "one of green-lagrange, small, hencky"),
        ("--strain-from", "nodes", "one of fit, quadratic-fit, shape"),
        ("--strain-window", "2", "odd number of points"),
    ],
)
def test_a_strain_that_does_not_exist_is_refused_with_what_does(folder, option, value, words):
    assert words in refusal(*command(folder, option, value))
