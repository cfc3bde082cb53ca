import numpy as np
import pytest

from dic.assessment.paper import (
    BASE,
    FINE,
    OVERSIZED,
    SWEEPS,
    back_projected_error,
    claim_limit,
    statistics,
)
from dic.calibration.pinhole.camera import Pinhole

PAN_30 = Pinhole.swung(pan_deg=30)


def test_pan_30_degrees_gives_the_paper_s_mean_and_maximum_on_the_base_grid() -> None:
    error = statistics(PAN_30, BASE)

    assert error.mean_px == pytest.approx(5.7e-3, abs=0.05e-3)
    assert error.maximum_px == pytest.approx(1.49e-2, abs=0.005e-2)


def test_points_between_the_lines_are_no_worse() -> None:
    assert statistics(PAN_30, FINE).maximum_px == pytest.approx(1.49e-2, abs=0.005e-2)


def test_points_beyond_the_grid_are_far_worse() -> None:
    assert statistics(PAN_30, OVERSIZED).maximum_px == pytest.approx(0.234, abs=0.0005)


def test_pincushion_of_1e_8_at_15_degrees_gives_the_paper_s_maximum() -> None:
    error = statistics(Pinhole.swung(pan_deg=15, k1_per_px2=1e-8), BASE)

    assert error.maximum_px == pytest.approx(2.8e-3, abs=0.05e-3)


def test_a_camera_that_looks_straight_has_no_error() -> None:
    assert statistics(Pinhole.swung(), OVERSIZED).maximum_px < 1e-9


def test_the_error_map_is_as_large_as_the_grid_and_worst_on_the_camera_s_side() -> None:
    error = back_projected_error(PAN_30, OVERSIZED)

    assert error.shape == (OVERSIZED.count, OVERSIZED.count)
    # positive pan turns the right side away, so that the left side is magnified
    assert np.unravel_index(error.argmax(), error.shape)[1] == 0


@pytest.mark.parametrize("swing", [(25, 25), (-25, 25), (25, -25)])
def test_signs_of_pan_and_tilt_do_not_matter(swing: tuple[float, float]) -> None:
    expected = statistics(Pinhole.swung(pan_deg=25, tilt_deg=25), BASE)

    assert statistics(Pinhole.swung(pan_deg=swing[0], tilt_deg=swing[1]), BASE).maximum_px == pytest.approx(
        expected.maximum_px, rel=1e-6
    )


def test_the_claim_of_a_fiftieth_pixel_holds_for_pan_but_not_for_the_other_sweeps() -> None:
    limits = {sweep.name: claim_limit(sweep) for sweep in SWEEPS}

    assert limits["pan"] is None
    assert limits["pan_tilt"] is not None
    assert 0 < limits["pan_tilt"] < 30
    assert limits["pincushion"] is not None
    assert 1e-8 < limits["pincushion"] < 1e-7
    assert limits["barrel"] is not None
    assert -1e-7 < limits["barrel"] < -1e-8


def test_the_claim_s_limit_is_where_the_maximum_is_a_fiftieth_pixel() -> None:
    sweep = next(sweep for sweep in SWEEPS if sweep.name == "pan_tilt")
    limit = claim_limit(sweep)

    assert limit is not None
    assert statistics(sweep.camera(limit), BASE).maximum_px == pytest.approx(0.02, rel=1e-4)
