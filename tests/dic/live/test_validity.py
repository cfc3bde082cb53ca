"""A live value says whether it may be used: each reason, and how the points are found again."""

import numpy as np
import pytest

from dic.correlation import kernel
from dic.gauges import Extensometer, StrainGauge
from dic.live import FieldSolver, LiveCamera, Reason
from tests.dic.live.rendered_frames import RenderedCamera, stretched

UPPER, LOWER = (
    StrainGauge(name=name, centre=(200, y), size=(60, 60), direction_deg=90.0)
    for name, y in (("upper", 120), ("lower", 280))
)
PX_MM = 1 / 70.0


@pytest.fixture(scope="module")
def seen():
    return RenderedCamera()


def test_a_frame_that_repeats_the_last_one_is_not_valid_and_keeps_its_values(seen):
    camera = LiveCamera(seen.setup((UPPER,), calibrated=False))
    frame = seen.frame(F=stretched(1e-3))
    first = camera.measure(frame, 0.0)
    for again in (camera.measure(frame.copy(), 0.1), camera.measure(seen.frame(), 0.0)):
        assert again.reason == again["upper"].reason == Reason.REPEATED
        assert again["upper"].value().strain == first["upper"].value().strain
        assert not again["upper"].value().valid
    assert camera.measure(seen.frame(), 0.2)["upper"].value().valid


def test_a_covered_lens_has_no_valid_value_and_costs_little(seen, monkeypatch):
    camera = LiveCamera(seen.setup((UPPER, LOWER), calibrated=False))
    camera.measure(seen.frame(), 0.0)
    tried = []
    true = kernel.correlate_seeds

    def counted(image, deformed, method, grid, seeds, *rest):
        tried.append(len(seeds))
        return true(image, deformed, method, grid, seeds, *rest)

    monkeypatch.setattr("dic.live.followed_tile.kernel.correlate_seeds", counted)
    rng = np.random.default_rng(1)
    counts = []
    for k in range(1, 6):
        tried.clear()
        image = camera.measure(rng.normal(12.0, 2.0, (400, 400)).clip(0, 255).astype(np.uint8), 0.1 * k)
        counts.append(sum(tried))
        assert {gauge.reason for gauge in image.gauges.values()} == {Reason.LOW_CORRELATION}
        assert image.lost == len(camera.points.tiles)
    # All points in the first frame, and then a few of each tile.
    assert counts[0] <= 2 * 49
    assert max(counts[1:]) <= 2 * 5
    for k in (6, 7):
        image = camera.measure(seen.frame(), 0.1 * k)
    assert all(gauge.value().valid for gauge in image.gauges.values())


def test_glare_at_one_gauge_leaves_the_other_valid(seen):
    camera = LiveCamera(seen.setup((UPPER, LOWER), calibrated=False))
    camera.measure(seen.frame(), 0.0)
    frame = seen.frame()
    frame[270:290, 180:220] = 255
    image = camera.measure(frame, 0.1)
    assert image["lower"].reason == Reason.SATURATED
    assert image["upper"].value().valid


@pytest.mark.parametrize("share", [0.06, 0.45])
def test_lost_points_count_against_the_least_share(seen, share):
    camera = LiveCamera(seen.setup((UPPER,), calibrated=False, most_saturated=1.0))
    camera.measure(seen.frame(), 0.0)
    frame = seen.frame()
    width = int(90 * share)
    frame[75:165, 245 - width : 245] = np.random.default_rng(0).integers(0, 120, (90, width))
    gauge = camera.measure(frame, 0.1)["upper"]
    reading = gauge.readings["raw"]
    assert reading.points < reading.declared
    assert gauge.value().valid == (reading.points >= 0.8 * reading.declared)
    assert gauge.value().valid == (share < 0.3)


def test_a_strain_that_jumps_is_believed_when_further_frames_confirm_it(seen):
    gauge = Extensometer(name="axial", start=(200, 100), end=(200, 300), patch=40)
    camera = LiveCamera(seen.setup((gauge,), calibrated=False, confirming_frames=3, most_strain_per_s=0.01))
    strains = [0.0, 1e-4, 8e-3, 8.1e-3, 8.2e-3, 8.3e-3]
    found = [
        camera.measure(seen.frame(F=stretched(strain)), 0.02 * k)["axial"].value()
        for k, strain in enumerate(strains)
    ]
    assert [value.reason for value in found] == [
        Reason.NONE, Reason.NONE, Reason.JUMP, Reason.JUMP, Reason.NONE, Reason.NONE,
    ]  # fmt: skip
    assert found[2].strain == pytest.approx(8e-3, abs=2e-4)


def test_a_tile_that_jumps_is_found_again_within_a_few_frames(seen):
    camera = LiveCamera(seen.setup((UPPER, LOWER), calibrated=False))
    camera.measure(seen.frame(), 0.0)
    valid = []
    for k in range(1, 10):
        image = camera.measure(seen.frame(shift_mm=(18 * PX_MM, -9 * PX_MM)), 0.1 * k)
        valid.append(all(gauge.value().valid for gauge in image.gauges.values()))
    assert not valid[0]
    assert valid[-1]
    assert sum(valid) >= 5


def test_a_gauge_behind_a_cover_is_found_where_the_others_have_moved(seen):
    camera = LiveCamera(seen.setup((UPPER, LOWER), calibrated=False, search_px=0))
    valid = []
    for k in range(12):
        frame = seen.frame(shift_mm=(0.0, -4 * k * PX_MM))
        if 2 <= k < 8:
            frame[60:220] = np.random.default_rng(k).integers(0, 40, (160, 400))
        image = camera.measure(frame, 0.1 * k)
        assert image["lower"].value().valid
        valid.append(image["upper"].value().valid)
    assert valid[:8] == [True] * 2 + [False] * 6
    assert valid[-2:] == [True] * 2


def test_points_that_are_far_away_are_sought_in_the_whole_frame(seen):
    setup = seen.setup((UPPER, LOWER), calibrated=False, search_px=0)
    camera, solver = LiveCamera(setup), FieldSolver(setup)
    camera.measure(seen.frame(), 0.0)
    away = seen.frame(shift_mm=(60 * PX_MM, 0.0))
    assert not camera.measure(away, 0.1)["upper"].value().valid
    sought = solver.seek(away, camera.lost)
    assert len(sought.rows)
    assert sought.start
    camera.accept(sought)
    for k in (2, 3, 4):
        image = camera.measure(seen.frame(shift_mm=(60 * PX_MM, 0.0)), 0.1 * k)
    assert all(gauge.value().valid for gauge in image.gauges.values())
    assert not len(camera.lost.rows)


def test_a_camera_without_motion_has_no_corrected_value(seen):
    camera = LiveCamera(seen.setup((UPPER,)))
    value = camera.measure(seen.frame(), 0.0)["upper"].value()
    assert value.kind == "calibrated"
    assert value.valid
    assert camera.measure(seen.frame(), 0.1)["upper"].reason_of("corrected") == Reason.NO_VALUE
