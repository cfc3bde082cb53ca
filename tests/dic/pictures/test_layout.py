"""In a picture of maps, each map lies on the right part of the image, and no parts overlap."""

import numpy as np
import pytest

import dic
from dic.pictures.maps import draw_maps
from dic.pictures.panels import maps_of, scale_of
from tests.dic.pictures.boxes import assert_apart_inside
from tests.dic.report.runs import affine

MAPS = 5


@pytest.fixture(
    scope="module",
    params=[("off", 250.0), ("px", 85.0), pytest.param(("px", 250.0), marks=pytest.mark.extended)],
    ids=str,
)
def settings(request):
    axes, width_mm = request.param
    return dic.MapSettings(axes=axes, width_mm=width_mm)


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


def test_maps_have_the_shape_of_the_image_and_show_all_of_it(drawn):
    figure, (height, width) = drawn
    for axis in figure.axes[::2]:
        box = axis.get_window_extent()
        assert box.height / box.width == pytest.approx(height / width, rel=1e-6)
        assert (*axis.get_xlim(), *axis.get_ylim()) == (-0.5, width - 0.5, height - 0.5, -0.5)


def test_background_is_as_bright_as_the_image_at_every_place(drawn):
    figure, (_, width) = drawn
    background = np.asarray(figure.axes[0].images[0].get_array())
    assert max(background.shape) <= 1200
    # The image becomes brighter from left to right, and its columns may have been joined to fewer.
    middles = (np.arange(background.shape[1]) + 0.5) * width / background.shape[1] - 0.5
    np.testing.assert_allclose(background[0], 200.0 * middles / (width - 1), atol=0.5)


def test_maps_bars_titles_and_labels_are_inside_the_figure_and_do_not_cover_each_other(drawn):
    figure, _ = drawn
    assert len(figure.axes) == 2 * MAPS
    boxes = [axis.get_tightbbox() for axis in figure.axes] + [figure._suptitle.get_window_extent()]
    assert_apart_inside(figure, boxes)
