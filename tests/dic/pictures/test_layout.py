"""In a picture of maps, each map lies on the right part of the image, and no parts overlap."""

import cv2
import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.transforms import Bbox

from dic.pictures.background import background_of
from dic.pictures.layout import PanelLayout
from tests.dic.pictures.boxes import assert_apart_inside
from tests.dic.pictures.pages import drawn as page_of, maps_on
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
    return {"axes": axes, "width_mm": width_mm}


@pytest.fixture(scope="module", params=[(120, 120), (120, 300), (3000, 1000)], ids=str)
def drawn(request, settings):
    """A page of maps for an image of the given shape, the background of its maps, and this shape."""
    height, width = request.param
    image = np.tile(np.linspace(0.0, 200.0, width, dtype=np.float32), (height, 1))
    measurement = affine(np.array([[0.1, 0.02], [0.03, -0.05]]), "step 3")
    page, maps = page_of(measurement, image, "step 3", **settings)
    return page, background_of(image, maps.places), (height, width)


def test_maps_have_the_shape_of_their_part_of_the_image_which_holds_all_points(drawn):
    page, background, (height, width) = drawn
    left, right, bottom, top = background.extent
    assert len(maps_on(page)) == MAPS
    for place in maps_on(page):
        # their sides are whole pixels
        assert place.height / place.width == pytest.approx((bottom - top) / (right - left), rel=0.02)
    assert -0.5 <= left < POINTS_PX[0] < POINTS_PX[1] < right <= width - 0.5
    assert -0.5 <= top < POINTS_PX[0] < POINTS_PX[1] < bottom <= height - 0.5
    # an image that is much larger than the measured part is not shown whole
    assert right - left < 2 * (POINTS_PX[1] - POINTS_PX[0] + 40)


def test_background_is_as_bright_as_the_image_at_every_place(drawn):
    _, background, (_, width) = drawn
    grey = background.grey
    assert max(grey.shape) <= 2400
    left, right, *_ = background.extent
    # The image becomes brighter from left to right, and its columns may have been joined to fewer.
    middles = left + (np.arange(grey.shape[1]) + 0.5) * (right - left) / grey.shape[1]
    np.testing.assert_allclose(grey[0], 200.0 * middles / (width - 1), atol=0.5)


def test_the_shown_image_is_pale_and_grows_brighter_like_the_image(drawn):
    shown = drawn[1].shown((90, 70))
    assert shown.shape == (70, 90, 3)
    assert (np.diff(shown[35, :, 0].astype(int)) >= 0).all()
    assert 150 <= shown.min() < 170
    assert 235 <= shown.max() < 255


@pytest.mark.parametrize("aspect", [0.1, 0.4, 1.0, 3.0, 8.0])
@pytest.mark.parametrize("number", [1, 3, 5, 16])
def test_panels_are_as_large_as_the_shape_of_the_specimen_permits(number, aspect):
    """No other number of columns has clearly larger panels in a picture of at most the same height."""
    chosen = PanelLayout.fitting(number, 250.0, 150, aspect, ticks=False, title=False)
    assert chosen.height_mm <= 1.4 * 250.0
    # all panels, with gaps, are inside the picture
    for index in range(number):
        place, bar = chosen.panel(index), chosen.bar(index)
        assert 1.0 < place.left < place.left + place.width < 249.0
        assert chosen.title_top(index) < bar.top < bar.top + bar.height < place.top
        assert place.top + place.height < chosen.height_mm
    for columns in range(1, number + 1):
        # what is left of the width and of the height for each panel, at best
        rows = -(-number // columns)
        width = min(250.0 / columns, chosen.highest * 250.0 / rows / aspect)
        assert chosen.axes_mm[0] >= 0.9 * (width - 16.0 - 16.0 / aspect)


def test_maps_bars_titles_and_labels_are_inside_the_page_and_do_not_cover_each_other(drawn):
    """The boxes of the text are measured by matplotlib."""
    page, _, _ = drawn
    assert len(page.pictures) == 2 * MAPS
    figure = page.figure()
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    (axis,) = figure.axes
    boxes = [text.get_window_extent() for text in axis.texts]
    for place, _ in page.pictures:
        left, top = axis.transData.transform((place.left, place.top))
        right, bottom = axis.transData.transform((place.left + place.width, place.top + place.height))
        # the numbers stand right below a line
        boxes.append(Bbox([[left, bottom], [right, top]]))
    assert len(boxes) > 5 * MAPS
    assert_apart_inside(figure, boxes)


def test_numbers_as_pixels_stand_where_they_stand_in_vector_files(drawn):
    """Both ways to draw a page agree: the same ink, apart from the smoothing of letters."""
    page, _, _ = drawn
    figure = page.figure()
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    vector, pixels = np.asarray(canvas.buffer_rgba())[..., :3], page.pixels()
    height, width = (min(one, other) for one, other in zip(vector.shape[:2], pixels.shape[:2], strict=True))
    assert abs(vector.shape[0] - pixels.shape[0]) <= 1
    shown = [each[:height, :width].astype(int) for each in (vector, pixels)]
    for one, other in (shown, shown[::-1]):
        # each dark pixel has ink of the other picture within two pixels
        dark, ink = (one.max(axis=2) < 90) & (np.ptp(one, axis=2) < 10), other.min(axis=2) < 140
        near = cv2.dilate(ink.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
        assert dark.sum() > 2000
        assert (dark & ~near).sum() <= 0.01 * dark.sum()
