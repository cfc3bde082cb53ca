"""The V4L2 driver delivers whole pictures at full bit depth, and flags or refuses all others."""

import numpy as np
import pytest

from drivers.cameras.v4l2.abi import BufferFlag
from drivers.cameras.v4l2.session import SHORT
from drivers.errors import DeviceFault
from tests.drivers.cameras.fake_kernel import FakeNode
from tests.drivers.cameras.v4l2.opening import opened


def number_of(image: np.ndarray, mask: int = 0xFFF, most: int = 5000) -> int:
    """Return the number of the picture that a frame shows."""
    levels = {(number * 37 + 11) & mask: number for number in range(min(most, mask // 37))}
    assert image.min() == image.max()
    return levels[int(image[0, 0])]


@pytest.mark.parametrize("padding", [0, 24])
@pytest.mark.parametrize(
    ("code", "bits", "dtype"),
    [
        ("GREY", 8, np.uint8),
        ("Y10", 10, np.uint16),
        ("Y12", 12, np.uint16),
        ("Y16", 16, np.uint16),
        ("YUYV", 8, np.uint8),
    ],
)
def test_every_format_arrives_at_full_depth_without_its_padding(code, bits, dtype, padding, plugged, context):
    plugged.padding, plugged.level_mask = padding, (1 << bits) - 1
    camera = opened(plugged, context, format=code)
    try:
        frame = camera.grab(1.0)
    finally:
        camera.close()
    assert camera.info.bits == bits
    assert (frame.image.dtype, frame.image.shape) == (dtype, (20, 32))
    assert frame.image.flags.c_contiguous
    assert np.unique(frame.image).tolist() == [((plugged.shown - 1) * 37 + 11) & (1 << bits) - 1]


def test_a_last_row_without_its_padding_is_a_whole_picture(plugged, context):
    plugged.padding = 24
    plugged.frame_faults = dict.fromkeys(range(1000), "unpadded")
    camera = opened(plugged, context)
    frame = camera.grab(1.0)
    camera.close()
    assert frame.flags == 0
    assert number_of(frame.image) == plugged.shown - 1


def test_a_damaged_and_a_short_frame_carry_flags(plugged, context):
    plugged.frame_faults = dict.fromkeys(range(2, 40), "damaged") | dict.fromkeys(range(40, 80), "short")
    camera = opened(plugged, context)
    try:
        frame = camera.grab(1.0)
        assert frame.flags == BufferFlag.ERROR
        while plugged.shown < 45:
            frame = camera.grab(1.0)
        assert frame.flags == SHORT
        assert (frame.image[10:] == 0).all()
        assert (frame.image[:10] == (plugged.shown - 1) * 37 + 11).all()
    finally:
        camera.close()


def test_rows_of_another_stride_than_asked_for_are_refused(plugged, context):
    with pytest.raises(DeviceFault, match="set stride: expected rows of 128 bytes, got rows of 64"):
        opened(plugged, context, stride_bytes=128)
    opened(plugged, context, stride_bytes=64).close()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"width": 24}, "expected 32 x 20 px Y12, got 24 x 20 px Y12"),
        ({"field": 4}, r"got 32 x 20 px Y12, interlaced \(field 4\)"),
        (
            {"sizeimage": 1000},
            "rows of at least 64 bytes, 20 of them, got rows of 64 bytes in buffers of 1000",
        ),
        ({"bytesperline": 60}, "expected rows of at least 64 bytes, 20 of them, got rows of 60 bytes"),
    ],
)
def test_a_picture_that_the_rate_has_changed_is_refused(changes, message, plugged, context, monkeypatch):
    answered = FakeNode.g_fmt

    def otherwise(node: FakeNode, format) -> None:
        answered(node, format)
        if plugged.rate_set:
            for name, value in changes.items():
                setattr(format.fmt.pix, name, value)

    plugged.rate_set = False
    monkeypatch.setattr(FakeNode, "g_fmt", otherwise)
    monkeypatch.setattr(FakeNode, "s_parm", lambda *_: setattr(plugged, "rate_set", True))
    with pytest.raises(DeviceFault, match=message):
        opened(plugged, context)
