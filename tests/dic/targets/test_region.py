"""An image with two targets is refused; a region selects one of them."""

import numpy as np
import pytest

from dic.errors import CalibrationError
from dic.targets.find import find_target
from dic.targets.kinds import CharucoTarget, CheckerboardTarget, DotTarget, Target
from tests.dic.targets.drawings import Drawing, View, charuco, checkerboard, dots

CHARUCO = CharucoTarget((6, 5), 1.2, 0.9)


@pytest.mark.parametrize(
    ("target", "drawing"),
    [
        pytest.param(DotTarget((8, 7), 0.9), dots((8, 7), 0.9, 0.22), marks=pytest.mark.extended),
        pytest.param(CheckerboardTarget((8, 7), 0.9), checkerboard((8, 7), 0.9), marks=pytest.mark.extended),
        (CHARUCO, charuco(CHARUCO)),
    ],
    ids=["dots", "checkerboard", "ChArUco"],
)
def test_two_targets_are_said_and_one_is_chosen_by_its_region(target: Target, drawing: Drawing) -> None:
    views = [
        View.of(drawing, roll, (400, 400), 1500.0, pan_deg=pan) for roll, pan in ((8.0, 10.0), (-15.0, 25.0))
    ]
    image = np.hstack([view.image() for view in views])

    with pytest.raises(CalibrationError, match=r"got two, around x .* and x .*; choose one .*--region"):
        find_target(image, target)
    left = find_target(image, target, region_px=(0, 0, 400, 400))
    right = find_target(image, target, region_px=(400, 0, 400, 400))
    assert views[0].rms_px(left) < 0.08
    assert np.sqrt(((right.uv_px - [400, 0] - views[1].project(right.xy_mm)) ** 2).sum(axis=1).mean()) < 0.08


@pytest.mark.parametrize("region_px", [(0, 0, 500, 100), (-1, 0, 100, 100), (0, 0, 10, 10)])
def test_a_region_outside_the_image_is_refused(region_px: tuple[float, float, float, float]) -> None:
    with pytest.raises(CalibrationError, match="give --region 0 0 400 200, or a part of it"):
        find_target(np.zeros((200, 400), np.float32), DotTarget((8, 7), 0.9), region_px=region_px)
