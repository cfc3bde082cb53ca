"""A tensile test in the report, from readings that are made by hand: its curves and its reasons."""

from itertools import pairwise

import numpy as np
import pytest

from dic import tensile_test
from dic.gauges import GaugeImage, GaugeSeries, Reading, StrainGauge
from dic.properties import PropertySettings
from dic.records.clock import MachineClock
from dic.records.joining import JoinedRecord
from dic.report.style import plot_style
from dic.report.tensile_figures import curves_figure, gauges_figure
from dic.report.tensile_page import remarks_of

AREA_MM2, E_MPA = 25.0, 70e3
FALSE = 3e-4
"""False strain of the uncorrected off-axis camera at the largest load."""


def drawn(noise=0.0, joined=None):
    """A test seen by two cameras; only the calibrated strain of the off-axis camera is wrong, and noisy."""
    gauges = (StrainGauge(name="along", unit="mm", centre=(0, 0), size=(5, 5), direction_deg=90.0),)
    images, errors = [], noise * np.random.default_rng(5).normal(size=30)
    for camera in ("off_axis", "on_axis"):
        for k, load_n in enumerate(np.linspace(200.0, 5000.0, 30)):
            strain = load_n / AREA_MM2 / E_MPA
            wrong = FALSE * load_n / 5000.0 + errors[k] if camera == "off_axis" else 0.0
            kinds = {"calibrated": strain + wrong, "corrected": strain}
            readings = {kind: Reading("mm", value, 5e-6, 5e-6) for kind, value in kinds.items()}
            known = {"camera": camera, "step": f"load {k}", "load_n": load_n, "time_s": float(k)}
            images.append(GaugeImage(f"step {k}", {"along": readings}, known, digest=f"{camera}{k}"))
    series, settings = GaugeSeries("", gauges, tuple(images)), PropertySettings(area_mm2=AREA_MM2)
    return tensile_test(series, "along", None, settings, joined=joined)


@pytest.fixture(scope="module")
def pulled():
    return drawn()


def test_modulus_that_cannot_be_had_has_its_reason_on_the_page_and_in_the_json():
    test = drawn(noise=1.5e-3)
    columns = {f"{column['camera']} {column['strain_kind']}": column for column in test.as_dict()["columns"]}
    lost = columns["off_axis calibrated"]["values"]["E_gpa"]
    assert lost["value"] is None
    (reason,) = (flag for flag in lost["flags"] if flag.startswith("missing: "))
    remarks = {remark.label: remark.sentences for remark in remarks_of(test)}
    assert f"E: {reason}" in remarks["off_axis, calibrated, uncorrected"]
    for name, column in columns.items():
        assert (column["values"]["E_gpa"]["value"] is None) == (name == "off_axis calibrated")
        assert [row["sha256"] for row in column["curve"]] == [f"{column['camera']}{k}" for k in range(30)]


def test_the_offset_between_the_clocks_is_stated_with_its_standard_deviation():
    clock = MachineClock(12.345, 0.031, 1.002, 0.0004, -0.5, "found", "given")
    joined = JoinedRecord(np.zeros(30), None, None, "time", 12.345, 0.031, "interval", clock)
    known = drawn(joined=joined).as_dict()["joined"]
    assert (known["offset_s"], known["offset_std_s"]) == (12.345, 0.031)
    assert (known["clock_rate"], known["clock_rate_std"], known["correlation"]) == (1.002, 0.0004, -0.5)
    assert joined.text.endswith(
        "minus image's time 12.345 s ± 0.031 s, found from load and strain,"
        " machine's seconds per image's second 1.002 ± 0.0004"
    )
    assert drawn().as_dict()["joined"] is None


def test_curves_differ_by_width_and_markers_and_their_differences_are_shown(pulled):
    with plot_style():
        whole, beginning, differences = curves_figure(pulled).axes
    for axes in (whole, beginning):
        lines = axes.get_lines()
        assert len(lines) == 4
        widths = [line.get_linewidth() for line in lines]
        assert all(wide > 1.2 * narrow for wide, narrow in pairwise(widths))
        assert len({line.get_marker() for line in lines}) == 4
        every = [line.get_markevery() for line in lines]
        marked = [np.arange(30)[first::step] for first, step in every]
        assert sorted(np.concatenate(marked)) == list(range(30))  # each point is marked by one curve
    shown = {line.get_label(): line for line in whole.get_lines()}
    assert list(shown) == [column.label for column in pulled.columns]
    colours = {label: line.get_color() for label, line in shown.items()}
    assert len({colours[label] for label in colours if label.startswith("on_axis")}) == 1
    curves = [line for line in differences.get_lines() if len(line.get_xdata()) == 30]
    assert [np.abs(line.get_xdata()).max() for line in curves] == pytest.approx([0.0, 0.0, 1e6 * FALSE])
    assert differences.get_xscale() == "symlog"


def test_each_gauge_has_a_curve_with_its_band(pulled):
    with plot_style():
        (axes,) = gauges_figure(pulled).axes
    line = next(line for line in axes.get_lines() if len(line.get_xdata()) == 30)
    assert line.get_xdata() == pytest.approx(100 * np.linspace(200.0, 5000.0, 30) / AREA_MM2 / E_MPA)
    (band,) = axes.collections
    across = band.get_paths()[0].get_extents()
    assert across.width == pytest.approx(np.ptp(line.get_xdata()) + 2 * 1.96 * 5e-4, rel=1e-6)
