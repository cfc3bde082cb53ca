"""The picture of gauges: lines and points at their places of the image, with names below it."""

import cv2
import numpy as np

import dic
from dic.gauges.picture import draw_gauges
from dic.gauges.placed import PlacedGauges
from tests.dic.pictures.fields import SHAPE, stretched
from tests.dic.pictures.pages import maps_on


def test_lines_and_points_of_a_gauge_have_its_colour_at_their_places(tmp_path):
    measurement = dic.measure(stretched(0.001))
    texts = (
        "long=extensometer unit=px start=80,70 end=220,70 patch=41",
        "middle=area unit=px centre=150,150 size=90,70",
    )
    placed = PlacedGauges.of(dic.read_gauges(texts=texts), measurement, None, SHAPE)
    page = draw_gauges(placed, measurement, np.full(SHAPE, 128.0, np.float32))
    page.write(tmp_path / "gauges.png")
    pixels = cv2.imread(str(tmp_path / "gauges.png"))[..., ::-1].astype(int)
    assert pixels.shape == page.pixels().shape
    (place,) = maps_on(page)

    def seen(x: float, y: float) -> list[int]:
        share = (x + 0.5) / SHAPE[1], (y + 0.5) / SHAPE[0]
        across, down = place.left + share[0] * place.width, place.top + share[1] * place.height
        return pixels[int(down / 25.4 * page.dpi), int(across / 25.4 * page.dpi)].tolist()

    orange, blue = [230, 159, 0], [86, 180, 233]
    assert seen(150, 70) == seen(185, 70) == orange  # between the patches
    assert seen(105, 157) == seen(195, 157) == blue  # the left and the right side of the area
    assert seen(140, 150) == blue  # a point, at 40 + 20 k and 30 + 20 k px
    assert np.ptp(seen(150, 160)) == np.ptp(seen(250, 220)) == 0  # between points, and outside
    assert [text.text for text in page.texts[-2:]] == ["long (extensometer)", "middle (area)"]
