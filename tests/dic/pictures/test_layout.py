"""In a picture of maps, each map lies on the right part of the image, and no parts overlap."""

import numpy as np
import pytest

import dic
from dic.pictures.layout import PanelLayout
from dic.pictures.maps import draw_maps
from dic.pictures.panels import maps_of, scale_of
from tests.dic.pictures.boxes import assert_apart_inside
from tests.dic.report.runs import affine

MAPS = 5
POINTS_PX = (40, 75)
"""First and last position of the points of `affine` in x and in y."""


@pytest.fixture(
    scope="module",
    params=[("off", 250.0), ("px", 85.0), pytest.param(("px", 250.0), marks=pytest.mark.extended)],
    ids=str,
)
def settings(request):
    axes, width_mm = request.param
    return dic.pictures.MapSettings(axes=axes, width_mm=width_mm)


@pytest.fixture(scope="module", params=[(120, 120), (120, 300), (3000, 1000)], ids=str)
def drawn(request, settings):
    """A figure of maps for an image of the given shape, and this shape; the figure is drawn only once."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    height, width = request.param
    image = np.tile(np.linspace(0.0, 200.0, width, dtype=np.float32), (height, 1))
    maps = maps_of(affine(np.array([[0.1, 0.02], [0.03, -0.05]]), "step 3"), settings)
    figure = draw_maps(maps, image, "step 3", settings, scale_of([maps], settings))
    FigureCanvasAgg(figure).draw()
    return figure, (height, width)


def test_maps_have_the_shape_of_their_part_of_the_image_which_holds_all_points(drawn):
    figure, (height, width) = drawn
    for axis in figure.axes[::2]:
        (left, right), (bottom, top) = axis.get_xlim(), axis.get_ylim()
        box = axis.get_window_extent()
        assert box.height / box.width == pytest.approx((bottom - top) / (right - left), rel=1e-6)
        assert -0.5 <= left < POINTS_PX[0] < POINTS_PX[1] < right <= width - 0.5
        assert -0.5 <= top < POINTS_PX[0] < POINTS_PX[1] < bottom <= height - 0.5
        # an image that is much larger than the measured part is not shown whole
        assert right - left < 2 * (POINTS_PX[1] - POINTS_PX[0] + 40)


def test_background_is_as_bright_as_the_image_at_every_place(drawn):
    figure, (_, width) = drawn
    background = np.asarray(figure.axes[0].images[0].get_array())
    assert max(background.shape) <= 1200
    left, right = figure.axes[0].get_xlim()
    # The image becomes brighter from left to right, and its columns may have been joined to fewer.
    middles = left + (np.arange(background.shape[1]) + 0.5) * (right - left) / background.shape[1]
    np.testing.assert_allclose(background[0], 200.0 * middles / (width - 1), atol=0.5)


@pytest.mark.parametrize("aspect", [0.1, 0.4, 1.0, 3.0, 8.0])
@pytest.mark.parametrize("number", [1, 3, 5, 16])
def test_panels_are_as_large_as_the_shape_of_the_specimen_permits(number, aspect):
    """No other number of columns has larger panels in a picture that is wider than high by a quarter."""
    chosen = PanelLayout.fitting(number, 250.0, aspect, ticks=False, title=False, bars=False)
    others = [PanelLayout(number, c, 250.0, aspect, False, False, False) for c in range(1, number + 1)]
    fitting = [one for one in others if one.height_mm <= 0.75 * 250.0]
    assert chosen in (fitting or others[-1:])
    assert all(chosen.columns <= one.columns for one in fitting)
    assert chosen.height_mm <= 1.1 * 250.0 + 1e-9


def test_maps_bars_titles_and_labels_are_inside_the_figure_and_do_not_cover_each_other(drawn):
    figure, _ = drawn
    assert len(figure.axes) == 2 * MAPS
    boxes = [figure._suptitle.get_window_extent()]
    for axis in figure.axes:
        # The title of a map may reach over its colour bar, but not into another part.
        if title := axis.get_title(loc="left"):
            boxes.append(axis._left_title.get_window_extent())
            axis.set_title("", loc="left")
        boxes.append(axis.get_tightbbox())
        axis.set_title(title, loc="left")
    assert_apart_inside(figure, boxes)
