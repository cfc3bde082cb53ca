"""The chart of a curve names its values at their places, and the names can be read."""

from itertools import combinations

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.text import Text

from dic.properties.curve import Curve
from dic.properties.plot import draw_properties
from dic.properties.properties import material_properties
from dic.properties.settings import PropertySettings
from tests.dic.properties.synthetic import strain_of_stress, with_plateau

AREA_MM2 = 10.0


def smooth():
    """A curve of an aluminium alloy: E = 70 GPa, Rp0.2 = 300 MPa."""
    stress = np.concatenate([np.linspace(0.0, 300.0, 120), np.linspace(301.0, 360.0, 60)])
    return strain_of_stress(stress, 70e3, 300.0, 12.0), stress


def mild_steel():
    """A curve with an upper yield point at 310 MPa, a plateau at 290 MPa and hardening by 120 MPa."""
    strain = np.concatenate([np.linspace(0.0, 290.0 / 200e3, 100), np.linspace(0.0015, 0.12, 400)])
    stress = with_plateau(strain, 200e3, 290.0, 0.012, 120.0)
    stress[100:103] = 310.0, 308.0, 300.0
    return strain, stress


@pytest.mark.parametrize(
    ("curve", "offsets", "named"),
    [
        (smooth, (0.2,), {"E = 70.0 GPa", "Rp0.2 = 300.0 MPa", "Rm = 360.0 MPa"}),
        (smooth, (0.1, 0.2, 0.5), {"E = 70.0 GPa", "Rp0.2 = 300.0 MPa", "Rm = 360.0 MPa"}),
        (mild_steel, (0.2,), {"E = 200.0 GPa", "ReH = 310.0 MPa", "ReL = 290.0 MPa"}),
    ],
)
def test_values_are_named_in_the_chart_without_covering_each_other(curve, offsets, named):
    strain, stress = curve()
    record = Curve("drawn", AREA_MM2 * stress, strain)
    found = material_properties(record, PropertySettings(area_mm2=AREA_MM2, offsets_percent=offsets))
    figure = draw_properties(found)
    FigureCanvasAgg(figure).draw()
    texts = [text for axes in figure.axes for text in axes.texts]
    lines = {line for text in texts for line in text.get_text().splitlines()}
    assert named <= lines
    assert sum(line.startswith("Rp") for line in lines) == len(offsets)
    for axes in figure.axes:
        boxes = [Text.get_window_extent(text) for text in axes.texts]  # without the lines to the marks
        whole = axes.get_window_extent()
        for box in boxes:
            assert whole.x0 <= box.x0
            assert box.x1 <= whole.x1
            assert whole.y0 <= box.y0
            assert box.y1 <= whole.y1
        assert not any(one.overlaps(other) for one, other in combinations(boxes, 2))


def test_a_strength_between_the_images_is_a_line_and_no_point_of_the_curve():
    strain, stress = smooth()
    passed_n = np.full((len(stress), 2), np.nan)
    passed_n[-1] = 500.0 * AREA_MM2  # an image without strain, just before the last point
    record = Curve("drawn", AREA_MM2 * stress, strain, passed_n=passed_n)
    found = material_properties(record, PropertySettings(area_mm2=AREA_MM2))
    assert found.values["Rm_mpa"].value == pytest.approx(500.0)
    assert "point" not in found.values["Rm_mpa"].window
    whole = draw_properties(found).axes[0]
    assert "Rm = 500.0 MPa, strain not known" in {text.get_text() for text in whole.texts}
    at_rm = [line for line in whole.lines if np.allclose(line.get_ydata(), 500.0)]
    assert [line.get_linestyle() for line in at_rm] == [":"]
    assert whole.get_ylim()[1] > 500.0
