"""Live gauges of one camera give what the offline measurement gives for the same frames."""

import pickle
import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

from dic.correlation.settings import CorrelationSettings
from dic.errors import CorrelationError, GaugeError
from dic.gauges import Extensometer, PointGauge, StrainGauge, TransverseExtensometer
from dic.live import LiveCamera, LiveSettings, LiveSetup, Reason
from dic.out_of_plane.motion import Motion
from tests.dic.live.rendered_frames import SIDE_PX, RenderedCamera, offline, stretched

LIMIT = 1e-6


def check_equal(setup, frames, kinds):
    """Assert that the live readings of all frames equal the offline ones."""
    camera = LiveCamera(setup)
    for k, frame in enumerate(frames):
        image, measured = camera.measure(frame, 0.1 * k), offline(setup, frame)
        expected = setup.placed.read(measured, None)
        for name, own in expected.items():
            assert not image[name].reason, (k, name, image[name])
            for kind in kinds:
                there, here = own[kind], image[name].readings[kind]
                if hasattr(there, "distance"):
                    np.testing.assert_allclose(here.values["exx"], there.values["exx"], atol=2 * LIMIT)
                    if kind == "raw":
                        np.testing.assert_allclose(here.values["exx_std"], there.values["exx_std"], rtol=1e-2)
                    continue
                assert here.strain == pytest.approx(there.strain, abs=LIMIT)
                assert here.strain_std_images == pytest.approx(there.strain_std_images, rel=1e-2)
                assert (here.points, here.declared) == (there.points, there.declared)
                for value, number in there.values.items():
                    if value in ("exx", "eyy", "exy"):
                        assert here.values[value] == pytest.approx(number, abs=LIMIT)


def test_every_kind_of_gauge_reads_as_offline_raw_and_calibrated():
    seen = RenderedCamera(tilt_deg=30.0)
    setup = seen.setup()
    frames = [seen.frame(F=stretched(2e-3 * k), shift_mm=(0.01 * k, 0.02 * k)) for k in range(5)]
    check_equal(setup, frames, ("raw", "calibrated"))


@pytest.mark.parametrize(("shape", "order", "smoothing"), [("affine", 3, 0.0), ("affine", 5, 0.6)])
def test_other_settings_of_the_correlation_hold_live_too(shape, order, smoothing):
    settings = CorrelationSettings(subset_px=31, step_px=10, shape=shape, order=order, smoothing_px=smoothing)
    seen = RenderedCamera(settings=settings)
    gauges = (
        TransverseExtensometer(name="width", start=(120, 200), end=(280, 200), patch=30, spread=100),
        StrainGauge(name="area", centre=(200, 200), size=(60, 60)),
    )
    frames = [seen.frame(F=stretched(3e-3 * k), shift_mm=(0.02 * k, 0.0)) for k in range(3)]
    check_equal(seen.setup(gauges, calibrated=False), frames, ("raw",))


def test_subsets_that_a_crack_cuts_read_as_offline():
    seen = RenderedCamera()
    region = np.zeros((SIDE_PX, SIDE_PX), bool)
    region[25:-25, 25:-25] = True
    region[196:197, 60:205] = False
    setup = replace(
        seen.setup(
            (PointGauge(name="beside", at=(150, 180), width=60), PointGauge(name="end", at=(215, 200))),
            calibrated=False,
            region=region,
        ),
        clip=True,
    )
    assert any(tile.cut for tile in LiveCamera(setup).points.tiles)
    check_equal(setup, [seen.frame(F=stretched(2e-3 * k)) for k in range(3)], ("raw",))


def test_points_are_followed_to_the_edge_of_the_image():
    """Steps of 5 px; the gauge is read as offline until its subsets leave the image."""
    seen = RenderedCamera()
    gauge = (StrainGauge(name="area", centre=(200, 300), size=(60, 60)),)
    setup = seen.setup(gauge, calibrated=False, room_px=8)
    camera = LiveCamera(setup)
    valid = []
    for k in range(16):
        frame = seen.frame(shift_mm=(0.0, -5.0 * k / 70.0))
        image = camera.measure(frame, 0.1 * k)["area"]
        valid.append(not image.reason)
        if image.reason:
            assert image.reason == Reason.OUTSIDE
        else:
            expected = setup.placed.read(offline(setup, frame), None)["area"]["raw"]
            assert image.readings["raw"].strain == pytest.approx(expected.strain, abs=LIMIT)
    # The lowest subsets end 400 - 300 - 30 - 15 px above the edge.
    assert 8 <= sum(valid) <= 13
    assert valid == sorted(valid, reverse=True)


def test_a_frame_needs_memory_for_the_gauges_only():
    seen = RenderedCamera()
    setup = seen.setup((StrainGauge(name="area", centre=(200, 200), size=(60, 60)),), calibrated=False)
    camera = LiveCamera(setup)
    frames = [seen.frame(shift_mm=(0.002 * k, 0.0)) for k in range(6)]
    for k in range(4):
        camera.measure(frames[k], float(k))
    tracemalloc.start()
    for k in (4, 5):
        camera.measure(frames[k], float(k))
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < SIDE_PX**2 / 2


def test_what_other_processes_need_can_be_sent_to_them():
    seen = RenderedCamera()
    setup = seen.setup()
    image = LiveCamera(setup).measure(seen.frame(F=stretched(1e-3)), 0.0)
    sent = pickle.dumps(setup)
    # The prepared reference stays.
    assert len(sent) < 3 * setup.reference.nbytes
    assert LiveCamera(pickle.loads(sent)).points.tiles[0].part == LiveCamera(setup).points.tiles[0].part
    received = pickle.loads(pickle.dumps(image))
    assert received["area"].value() == image["area"].value()
    assert received["area"].readings["raw"].values["exx"] == image["area"].readings["raw"].values["exx"]


def test_a_wrong_frame_is_refused_with_one_sentence():
    seen = RenderedCamera()
    camera = LiveCamera(
        seen.setup((StrainGauge(name="area", centre=(200, 200), size=(60, 60)),), calibrated=False)
    )
    with pytest.raises(CorrelationError, match="expected grey levels of 400 x 400 px, got an array of shape"):
        camera.measure(np.zeros((300, 400), np.uint8), 0.0)
    with pytest.raises(CorrelationError, match="got a list"):
        camera.measure([[1, 2]], 0.0)


def test_a_gauge_where_nothing_was_measured_is_refused():
    seen = RenderedCamera()
    away = (Extensometer(name="away", start=(3, 3), end=(3, 9), patch=4),)
    with pytest.raises(GaugeError, match="gauge 'away'"):
        LiveCamera(seen.setup(away, calibrated=False))
    with pytest.raises(GaugeError, match="expected gauges, got none"):
        LiveSetup(seen.frame(), ())
    with pytest.raises(GaugeError, match="the motion tension"):
        seen.setup(motion=Motion("rigid"))
    with pytest.raises(GaugeError, match="least share of points"):
        LiveSettings(least_share=0.2)
