"""Series with several references, because of changing patterns or large strain; the motion is known."""

import gc
import tracemalloc

import cv2
import numpy as np
import pytest

from dic.correlation.chaining import chain, moved_region
from dic.correlation.correlator import Correlator
from dic.correlation.series import Series
from dic.correlation.settings import CorrelationSettings
from dic.errors import CorrelationError, ImageError
from dic.image.read import read_image

SETTINGS = CorrelationSettings(subset_px=21, step_px=7)
SHAPE = (90, 260)
CENTRE_X = 129.5
PERIOD_PX = 60.0
FRAMES = 16
MEAN_STRAIN = 0.6


def displacement(x, share):
    """Return the displacement of a strain that varies periodically from 0 to 120 % along x, times `share`."""
    wave = 2 * np.pi / PERIOD_PX
    return share * MEAN_STRAIN * (x - CENTRE_X + np.sin(wave * (x - CENTRE_X)) / wave)


def back_of(share):
    here = np.linspace(-50, 310, 36001)
    there = here + displacement(here, share)
    return lambda x, y: (np.interp(x, there, here), y)


@pytest.fixture(scope="module")
def region():
    region = np.zeros(SHAPE, bool)
    region[15:75, 65:195] = True
    return region


@pytest.fixture(scope="module")
def stretching(speckle):
    pattern = speckle(seed=51, shape=SHAPE, margin=10, noise=1.0)
    return [pattern.draw(back_of(k / FRAMES), k) for k in range(FRAMES + 1)]


def measured(series, frames):
    for image in frames[1:]:
        field = series.correlate(image)
    return field


def test_large_strain_that_direct_correlation_loses_is_followed(stretching, region):
    settings = CorrelationSettings(subset_px=21, step_px=7, shape="quadratic")
    direct = measured(Series(stretching[0], region, settings, incremental="never"), stretching)
    # Quadratic subsets that start from their neighbours find three quarters of the points, and no more.
    assert direct.converged.sum() < 0.8 * direct.active.sum()
    series = Series(stretching[0], region, settings)
    field = measured(series, stretching)
    assert 1 <= series.updates < FRAMES
    assert field.converged.sum() > 0.97 * field.active.sum()
    truth = np.broadcast_to(displacement(field.x_px, 1.0), field.u_px.shape)
    error = (field.u_px - truth)[field.converged]
    # Subsets of 21 px smooth a wave of 60 px, whose crests are 5.7 px high, by one or two per cent.
    assert np.sqrt(np.mean(error**2)) < 0.1
    assert np.sqrt(np.mean(field.v_px[field.converged] ** 2)) < 0.05
    slope = np.polyfit(
        np.broadcast_to(field.x_px, truth.shape)[field.converged], field.u_px[field.converged], 1
    )
    expected = np.polyfit(
        np.broadcast_to(field.x_px, truth.shape)[field.converged], truth[field.converged], 1
    )
    assert slope[0] == pytest.approx(expected[0], abs=1e-3)


def test_a_reference_that_serves_is_kept(speckle):
    pattern = speckle(seed=53, noise=1.0)
    series = Series(pattern.draw(), settings=SETTINGS)
    for k in range(1, 5):
        field = series.correlate(pattern.draw(lambda x, y, k=k: (x - 0.8 * k, y), noise_seed=k))
    assert series.updates == 0
    np.testing.assert_allclose(field.u_px[field.converged], 3.2, atol=0.05)


def test_the_stated_error_grows_with_every_update(speckle):
    pattern = speckle(seed=54, noise=2.0)
    series = Series(pattern.draw(noise_seed=99), settings=SETTINGS, incremental="always")
    stated = []
    for k in range(1, 6):
        field = series.correlate(pattern.draw(lambda x, y, k=k: (x - 0.8 * k, y + 0.3 * k), noise_seed=k))
        stated.append(np.nanmedian(field.std_u_px))
    assert series.updates == 4
    np.testing.assert_allclose(stated, stated[0] * np.sqrt(np.arange(1, 6)), rtol=0.1)
    error = (field.u_px - 4.0)[field.converged]
    assert abs(error.mean()) < 0.01
    assert np.sqrt(np.mean(error**2)) < 1.2 * stated[-1]


def test_a_chain_of_two_fields_is_their_exact_composition(speckle, turn):
    """A turn by 7 degrees, then one by 8: sub-pixel places, gradients that matter, exact truth."""
    pattern, centre = speckle(seed=55, shape=(200, 200)), (99.5, 99.5)
    pictures = [pattern.draw(turn(angle, centre)) for angle in (0.0, 7.0, 15.0)]
    first = Correlator(pictures[0], settings=SETTINGS).correlate(pictures[1])
    second = Correlator(pictures[1], settings=SETTINGS).correlate(pictures[2])
    field = chain(first, second)
    x, y = np.meshgrid(field.x_px - centre[0], field.y_px - centre[1])
    c, s = np.cos(np.radians(15.0)), np.sin(np.radians(15.0))
    inner = np.hypot(x, y) < 60
    assert field.converged[inner].all()
    np.testing.assert_allclose(field.u_px[inner], (c * x + s * y - x)[inner], atol=3e-3)
    np.testing.assert_allclose(field.v_px[inner], (-s * x + c * y - y)[inner], atol=3e-3)
    shape = (inner.sum(), 4)
    np.testing.assert_allclose(
        field.gradient[inner], np.broadcast_to([c - 1, s, -s, c - 1], shape), atol=1e-3
    )


def test_a_region_moves_with_the_surface(speckle, turn):
    pattern, centre = speckle(seed=56, shape=(200, 220)), (109.5, 99.5)
    y, x = np.mgrid[:200, :220]
    ring = (np.hypot(x - 95, y - 99.5) < 60) & (np.hypot(x - 95, y - 99.5) > 20)
    field = Correlator(pattern.draw(), ring, SETTINGS).correlate(pattern.draw(turn(30.0, centre)))
    c, s = np.cos(np.radians(30.0)), np.sin(np.radians(30.0))
    to_x, to_y = centre[0] + c * -14.5, centre[1] - s * -14.5
    distance = np.hypot(x - to_x, y - to_y)
    moved = moved_region(ring, field)
    assert moved[(distance < 54) & (distance > 26)].mean() > 0.99
    assert not moved[(distance > 62) | (distance < 18)].any()


def test_an_image_that_fails_does_not_end_the_series(speckle):
    pattern, other = speckle(seed=57, noise=1.0), speckle(seed=58)
    series = Series(pattern.draw(), settings=SETTINGS)
    series.correlate(pattern.draw(lambda x, y: (x - 0.5, y), noise_seed=1))
    with pytest.raises(CorrelationError):
        series.correlate(other.draw())
    field = series.correlate(pattern.draw(lambda x, y: (x - 1.5, y), noise_seed=2))
    np.testing.assert_allclose(field.u_px[field.converged], 1.5, atol=0.05)
    assert series.updates == 0


@pytest.mark.extended
@pytest.mark.parametrize(("incremental", "images"), [("never", 20), ("always", 8)])
def test_memory_does_not_grow_with_the_number_of_images(speckle, incremental, images):
    pattern = speckle(seed=59, shape=(80, 90), margin=10)
    series = Series(pattern.draw(), settings=SETTINGS, incremental=incremental, threads=1)
    image = pattern.draw(lambda x, y: (x - 0.5, y))

    def in_use_after_all():
        for _ in range(images):
            series.correlate(image.copy())
        gc.collect()
        # Arrays alone: whatever else lives in this process, another test's thread too, allocates as it likes.
        arrays = tracemalloc.DomainFilter(inclusive=True, domain=np.lib.tracemalloc_domain)
        return sum(trace.size for trace in tracemalloc.take_snapshot().filter_traces([arrays]).traces)

    tracemalloc.start()
    try:
        in_use_after_all()
        growth = -in_use_after_all() + in_use_after_all()
    finally:
        tracemalloc.stop()
    # One image kept for each that was measured would be 20 or 8 images.
    assert growth < images / 4 * image.nbytes


def test_an_unknown_way_of_taking_new_references_is_refused(speckle):
    with pytest.raises(CorrelationError, match="auto or never or always, got sometimes"):
        Series(speckle().draw(), settings=SETTINGS, incremental="sometimes")


@pytest.mark.parametrize("hint", ["a turn", np.eye(2), np.full((3, 3), np.nan)])
def test_an_expected_motion_that_is_none_is_refused(speckle, hint):
    pattern = speckle(shape=(90, 100))
    series = Series(pattern.draw(), settings=SETTINGS)
    with pytest.raises(
        CorrelationError, match=r"hint: expect motion: expected a homography of shape \(3, 3\)"
    ):
        series.correlate(pattern.draw(), hint=hint)


@pytest.fixture(scope="module")
def changing(speckle):
    """Images of 8 bit that move by 1 px each; from the second on, their pattern is more and more another."""
    first, then = (speckle(seed=seed, shape=(90, 90), margin=12, noise=0.5) for seed in (61, 62))
    pictures = []
    for k in range(5):
        share = 0.3 * max(k - 1, 0)
        old, new = (own.draw(lambda x, y, k=k: (x - k, y), k) for own in (first, then))
        pictures.append(np.clip(np.rint((1 - share) * old + share * new), 0, 255).astype(np.uint8))
    return pictures


def taken_into(place, pictures, path):
    """Yield the pictures, of which each one replaces the one before in the same array or file."""
    buffer = pictures[0].astype(np.float32) if place == "float buffer" else pictures[0].copy()
    for picture in pictures:
        if place == "file":
            assert cv2.imwrite(str(path), picture)
            yield path
        else:
            buffer[...] = picture
            yield buffer


@pytest.mark.parametrize(
    ("place", "incremental"),
    [
        pytest.param("buffer", "auto", marks=pytest.mark.extended),
        *((each, "always") for each in ("float buffer", "large buffer")),
        *(pytest.param(each, "always", marks=pytest.mark.extended) for each in ("buffer", "file")),
    ],
)
def test_reference_is_the_correlated_image_after_its_place_has_the_next_one(
    changing, place, incremental, tmp_path, monkeypatch
):
    if place.startswith("large"):
        monkeypatch.setattr("dic.image.stored.WHOLE_PX", 0)
    series = Series(changing[0], None, SETTINGS, incremental=incremental, threads=1)
    for k, image in enumerate(taken_into(place, changing[1:], tmp_path / "live.png"), 1):
        field = series.correlate(image)
        # The other pattern disturbs a tenth of a pixel. The next image as reference would be 1 px wrong.
        np.testing.assert_allclose(np.median(field.u_px[field.converged]), k, atol=0.2)
    assert series.updates > 0


@pytest.mark.parametrize("large", [False, True])
def test_first_reference_is_kept_although_its_array_gets_the_next_image(changing, large, monkeypatch):
    if large:
        monkeypatch.setattr("dic.image.stored.WHOLE_PX", 0)
    buffer = changing[0].copy()
    series = Series(buffer, None, SETTINGS, incremental="never", threads=1)
    buffer[:] = changing[1]
    field = series.correlate(buffer)
    np.testing.assert_allclose(np.median(field.u_px[field.converged]), 1.0, atol=0.2)


@pytest.mark.parametrize("replaced", [False, True])
def test_large_image_is_read_again_as_reference_only_from_its_own_file(
    changing, replaced, tmp_path, monkeypatch
):
    monkeypatch.setattr("dic.image.stored.WHOLE_PX", 0)
    paths = [tmp_path / f"{k}.png" for k in range(3)]
    for path, picture in zip(paths, changing, strict=False):
        assert cv2.imwrite(str(path), picture)
    series = Series(read_image(paths[0]), None, SETTINGS, incremental="always", threads=1)
    series.correlate(paths[1])
    if replaced:
        assert cv2.imwrite(str(paths[1]), changing[3])
        with pytest.raises(
            ImageError, match=r"1\.png.*expected the image that was correlated, got another one"
        ):
            series.correlate(paths[2])
        return
    field = series.correlate(paths[2])
    np.testing.assert_allclose(np.median(field.u_px[field.converged]), 2.0, atol=0.2)
