"""Images that callers give as arrays, and whose arrays they may use again."""

import numpy as np
import pytest

from dic.image.given import fixed, grey_image, kept
from dic.image.stored import WHOLE_PX


@pytest.mark.parametrize("mapped", [False, True])
def test_kept_grey_levels_do_not_change_with_the_array_of_the_caller(tmp_path, mapped):
    given = np.full((40, 50), 7.0, np.float32)
    if mapped:
        given = np.memmap(tmp_path / "image.raw", np.float32, "w+", shape=given.shape)
        given[:] = 7.0
    grey = kept(grey_image(given, "image"), given)
    given[:] = 9.0
    assert (grey == 7.0).all()


def test_grey_levels_that_nobody_else_has_are_not_copied():
    given = np.full((40, 50), 7, np.uint8)
    grey = grey_image(given, "image")
    assert kept(grey, given) is grey
    assert kept(grey, "image.png") is grey


@pytest.mark.parametrize("hole", [False, True])
def test_only_a_large_mask_that_is_true_everywhere_takes_no_memory(hole):
    mask = np.ones((4, WHOLE_PX // 4 + 1), np.bool_)
    mask[2, 5] = not hole
    found = fixed(mask)
    assert (found is mask) == hole
    assert found.strides == (mask.strides if hole else (0, 0))
    assert not found.flags.writeable
    np.testing.assert_array_equal(found, mask)
