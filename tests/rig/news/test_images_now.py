"""Light and focus of the newest images are measured for people, seldom and against the reference image."""

from dataclasses import dataclass, field
from types import SimpleNamespace

import numpy as np
import pytest

from drivers.clock import VirtualClock
from drivers.interfaces import CameraInfo, Frame
from rig.news.images_now import AGAIN_S, ImagesNow

INFO = CameraInfo("fakes", "camera", "1", width_px=240, height_px=240, bits=8)


@dataclass
class Images:
    """What an engine shows of its images."""

    newest_images: dict[str, Frame] = field(default_factory=dict)
    context: SimpleNamespace = field(
        default_factory=lambda: SimpleNamespace(
            rig=SimpleNamespace(cameras={"left": SimpleNamespace(info=INFO)})
        )
    )

    def show(self, image: np.ndarray, clock: VirtualClock) -> None:
        self.newest_images["left"] = Frame(image, 0.0, 0.0, clock.utc(), 1, 0, 1.0, 1.0)


def stripes(mean: int, amplitude: int) -> np.ndarray:
    """Return stripes in both directions whose pixels two apart differ by twice the amplitude."""
    wave = np.resize([1, 1, -1, -1], 240)
    return (mean + amplitude * wave[:, None] * wave[None, :]).astype(np.uint8)


def test_sharpness_and_light_have_the_values_of_the_stripes():
    engine, clock = Images(), VirtualClock()
    images = ImagesNow(engine, clock)
    assert images.now() == {}
    engine.show(stripes(102, 40), clock)
    images.keep_reference()
    assert images.latest["left"].sharpness == pytest.approx(1.0)
    dim = stripes(51, 10)
    dim[:24] = 255
    engine.show(dim, clock)
    clock.sleep(AGAIN_S)
    found = images.now()["left"]
    assert found.saturated == pytest.approx(0.1)
    assert found.brightness == pytest.approx(0.9 * 0.2 + 0.1, rel=1e-3)
    engine.show(stripes(51, 10), clock)
    clock.sleep(AGAIN_S)
    # half the modulation of the reference
    assert images.now()["left"].sharpness == pytest.approx(0.5)


def test_images_are_measured_once_a_second_and_at_the_end():
    engine, clock = Images(), VirtualClock()
    images = ImagesNow(engine, clock)
    engine.show(stripes(102, 40), clock)
    first = images.now()["left"]
    engine.show(stripes(51, 10), clock)
    clock.sleep(0.9 * AGAIN_S)
    assert images.now()["left"] is first
    assert images.now(at_once=True)["left"].brightness == pytest.approx(0.2)
