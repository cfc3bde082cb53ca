"""Tests with motions whose strain is known from formulas."""

import numpy as np
import pytest
from scipy.signal import fftconvolve

from dic.correlation.correlator import Correlator
from dic.correlation.settings import CorrelationSettings
from dic.errors import CorrelationError
from dic.strain.displacement import Displacement, Noise, raw_displacement
from dic.strain.error_overlap import error_overlap
from dic.strain.settings import StrainSettings
from dic.strain.strain import gauge_text, mean_strain, strain_field
from dic.strain.tensor import strain_of

X, Y = np.meshgrid(np.linspace(-4, 5, 12), np.linspace(-3, 6, 10))


def moved(to):
    position = np.stack([X, Y], axis=-1)
    return Displacement(position, np.stack(to(X, Y), axis=-1) - position, np.ones(X.shape, bool), "mm")


@pytest.mark.parametrize("angle_deg", [0.0, 22.5, 90.0, 180.0, -135.0])
def test_a_rigid_turn_strains_nothing(angle_deg):
    c, s = np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))
    strain = mean_strain(moved(lambda x, y: (c * x - s * y + 3, s * x + c * y - 7)))
    np.testing.assert_allclose([strain.exx, strain.eyy, strain.exy], 0, atol=1e-14)
    assert np.cos(np.radians(strain.rotation_deg - angle_deg)) == pytest.approx(1, abs=1e-14)


def test_a_stretch_gives_half_of_its_square_less_one():
    strain = mean_strain(moved(lambda x, y: (0.97 * x, 1.05 * y)))
    assert strain.exx == pytest.approx((0.97**2 - 1) / 2)
    assert strain.eyy == pytest.approx((1.05**2 - 1) / 2)
    assert strain.exy == pytest.approx(0, abs=1e-14)


def test_simple_shear_turns_x_towards_y_when_y_moves():
    strain = mean_strain(moved(lambda x, y: (x, y + 0.02 * x)))
    assert strain.exy == pytest.approx(0.01)
    assert strain.rotation_deg == pytest.approx(np.degrees(np.arctan(0.01)))


def test_the_mean_uses_valid_points_only():
    motion = moved(lambda x, y: (1.01 * x, y))
    spoiled = motion.vector.copy()
    spoiled[2, 3] = 100.0
    spoiled[4, 5] = np.nan
    valid = motion.valid.copy()
    valid[2, 3] = valid[4, 5] = False
    strain = mean_strain(Displacement(motion.position, spoiled, valid, "mm"))
    assert strain.exx == pytest.approx((1.01**2 - 1) / 2)
    assert strain.points == X.size - 2


@pytest.mark.parametrize("count", [0, 2])
def test_too_few_points_have_no_strain(count):
    valid = np.zeros(X.shape, bool)
    valid.ravel()[:count] = True
    strain = mean_strain(moved(lambda x, y: (x, y)), valid)
    assert np.isnan([strain.exx, strain.eyy, strain.exy, strain.rotation_deg]).all()
    assert strain.as_dict()["exx"] is None


def test_points_on_one_line_have_no_strain():
    valid = np.zeros(X.shape, bool)
    valid[3] = True
    assert np.isnan(mean_strain(moved(lambda x, y: (x, y)), valid).exx)


def test_local_strain_follows_a_gradient_of_strain():
    # u = k x²/2 has ∂u/∂x = k x, which a plane fitted to a symmetric window meets exactly at its middle.
    k = 1e-3
    field = strain_field(moved(lambda x, y: (x + k * x**2 / 2, y)))
    expected = ((1 + k * X) ** 2 - 1) / 2
    np.testing.assert_allclose(field.exx[:, 2:-2], expected[:, 2:-2], atol=1e-12)
    np.testing.assert_allclose(field.eyy[:, 2:-2], 0, atol=1e-12)


def test_local_strain_is_missing_where_its_window_is_too_empty():
    motion = moved(lambda x, y: (1.01 * x, y))
    valid = motion.valid.copy()
    valid[:, :6] = False
    field = strain_field(Displacement(motion.position, motion.vector, valid, "mm"))
    assert np.isnan(field.exx[:, :6]).all()
    assert np.isfinite(field.exx[2:-2, 6:-2]).all()


@pytest.mark.parametrize("window", [1, 4])
def test_impossible_windows_are_refused(window):
    with pytest.raises(CorrelationError, match="odd number of points"):
        StrainSettings(window_points=window)


def test_all_impossible_settings_are_reported_together():
    with pytest.raises(CorrelationError) as caught:
        StrainSettings("true", 4, "nodes")
    for sentence in (
        "got true; give green-lagrange",
        "got 4; give a strain window between 3 and 21 points, odd",
        "got nodes; give fit",
    ):
        assert sentence in str(caught.value)


def test_each_measure_follows_its_definition_under_stretch_and_turn():
    c, s = np.cos(0.3), np.sin(0.3)
    motion = moved(lambda x, y: (c * 1.2 * x - s * 0.9 * y, s * 1.2 * x + c * 0.9 * y))
    expected = {
        "green-lagrange": ((1.2**2 - 1) / 2, (0.9**2 - 1) / 2, 0.0),
        "hencky": (np.log(1.2), np.log(0.9), 0.0),
        "small": (1.2 * c - 1, 0.9 * c - 1, s * (1.2 - 0.9) / 2),
    }
    for measure, (exx, eyy, exy) in expected.items():
        mean = mean_strain(motion, measure=measure)
        np.testing.assert_allclose([mean.exx, mean.eyy, mean.exy], [exx, eyy, exy], atol=1e-13)
        field = strain_field(motion, StrainSettings(measure))
        np.testing.assert_allclose(field.exx[2:-2, 2:-2], exx, atol=1e-12)
        np.testing.assert_allclose(field.exy[2:-2, 2:-2], exy, atol=1e-12)


@pytest.mark.parametrize("measure", ["green-lagrange", "hencky"])
def test_principal_strains_are_those_of_the_stretch_and_lie_where_it_was_pulled(measure):
    # Pulled by 1.3 at 25° from x towards y, 0.95 across.
    n, m = (
        np.array([np.cos(np.radians(25)), np.sin(np.radians(25))]),
        np.array([-np.sin(np.radians(25)), np.cos(np.radians(25))]),
    )
    U = 1.3 * np.outer(n, n) + 0.95 * np.outer(m, m)
    mean = mean_strain(
        moved(lambda x, y: (U[0, 0] * x + U[0, 1] * y, U[1, 0] * x + U[1, 1] * y)), None, measure
    )
    law = np.log if measure == "hencky" else lambda stretch: (stretch**2 - 1) / 2
    np.testing.assert_allclose([mean.e1, mean.e2], [law(1.3), law(0.95)], atol=1e-12)
    assert mean.direction_deg == pytest.approx(25.0)


@pytest.mark.parametrize("measure", ["green-lagrange", "small", "hencky"])
def test_deviations_are_the_derivatives_of_the_measure_times_the_errors(measure):
    rng = np.random.default_rng(3)
    gradient = rng.normal(0, 0.1, (20, 2, 2))
    root = rng.normal(0, 1e-7, (20, 4, 4))
    strain, deviation = strain_of(gradient, root @ np.swapaxes(root, 1, 2), measure)
    changes = []
    for k in range(4):
        step = root[:, :, k].reshape(20, 2, 2)
        ahead, behind = (strain_of(gradient + sign * step, None, measure)[0] for sign in (1, -1))
        changes.append((ahead - behind) / 2)
    np.testing.assert_allclose(deviation, np.sqrt(np.sum(np.square(changes), axis=0)), rtol=1e-4)
    assert np.isfinite(strain).all()


def test_without_strain_any_direction_is_possible():
    _, deviation = strain_of(np.zeros((2, 2)), 1e-12 * np.eye(4), "hencky")
    # A direction that may be any within 180° is evenly distributed.
    assert deviation[5] == pytest.approx(180 / np.sqrt(12))
    np.testing.assert_allclose(deviation[:2], 1e-6)


def test_a_quadratic_fit_follows_strain_that_curves_where_a_plane_cannot():
    k = 1e-4
    motion = moved(lambda x, y: (x + k * x**3, y))
    exact = ((1 + 3 * k * X**2) ** 2 - 1) / 2
    inner = (slice(2, -2), slice(2, -2))
    plane = strain_field(motion, StrainSettings(window_points=5, source="fit")).exx[inner] - exact[inner]
    # The slope of x³ that a plane, or a surface of second degree, sees over 5 points a step h apart: 3.4 h².
    h = X[0, 1] - X[0, 0]
    np.testing.assert_allclose(plane, k * 3.4 * h**2, rtol=0.02)
    square = moved(lambda x, y: (x + k * x**2, y))
    spoiled = square.valid.copy()
    spoiled[:, 0] = False
    one_sided = Displacement(square.position, square.vector, spoiled, "mm")
    expected = ((1 + 2 * k * X) ** 2 - 1) / 2
    curved = strain_field(one_sided, StrainSettings(window_points=5, source="quadratic-fit"))
    np.testing.assert_allclose(curved.exx[2:-2, 1:-2], expected[2:-2, 1:-2], atol=1e-12)
    straight = strain_field(one_sided, StrainSettings(window_points=5, source="fit"))
    assert np.abs(straight.exx[2:-2, 1] - expected[2:-2, 1]).max() > 1e-5


def pixel_weights(subset_px, shape):
    """Return the weight of each pixel in the middle value of the polynomial that is fitted to a subset."""
    at = np.linspace(-1, 1, subset_px)
    x, y = np.meshgrid(at, at)
    powers = [(0, 0), (1, 0), (0, 1)] + ([(2, 0), (1, 1), (0, 2)] if shape == "quadratic" else [])
    design = np.stack([x.ravel() ** i * y.ravel() ** j for i, j in powers], axis=1)
    basis, _ = np.linalg.qr(design)
    return (basis @ basis[subset_px**2 // 2]).reshape(subset_px, subset_px)


@pytest.mark.parametrize(
    ("source", "shape"),
    [
        pytest.param("fit", "affine", marks=pytest.mark.extended),
        ("quadratic-fit", "quadratic"),
        pytest.param("fit", "quadratic", marks=pytest.mark.long),
        pytest.param("quadratic-fit", "affine", marks=pytest.mark.long),
    ],
)
def test_predicted_deviations_are_those_of_errors_that_overlapping_subsets_share(shape, source):
    """Errors of displacement made from white noise of the pixels, as the subsets sum it up."""
    settings = CorrelationSettings(subset_px=21, step_px=6, shape=shape)
    rng, rows, columns, trials = np.random.default_rng(5), 14, 16, 400
    weights = pixel_weights(21, shape)
    std = 0.01 * (1 + 0.5 * np.arange(columns) / columns) * np.ones((rows, 1))
    noise = rng.normal(size=(2, trials, 20 + 6 * rows, 20 + 6 * columns))
    summed = fftconvolve(noise, weights[None, None], mode="valid", axes=(2, 3))[..., ::6, ::6][
        ..., :rows, :columns
    ]
    errors = summed / np.linalg.norm(weights) * std
    x, y = np.meshgrid(6.0 * np.arange(columns), -6.0 * np.arange(rows))
    position = np.stack([x, y], axis=-1)
    vector = np.stack([0.02 * x, 0.1 * x - 0.01 * y], axis=-1)
    valid = np.ones((rows, columns), bool)
    valid[4, 5] = valid[9:11, 8] = False
    factors = std[..., None, None] * np.eye(2)
    model = Noise(factors, error_overlap(settings), np.zeros((rows, columns, 4, 4)))
    chosen = StrainSettings(source=source)
    means, fields = [], []
    for k in range(trials):
        # Only the deviations that the first trial states are compared; computing them takes most of the time.
        states = model if k == 0 else None
        seen = Displacement(position, vector + np.moveaxis(errors[:, k], 0, -1), valid, "px", None, states)
        means.append(mean_strain(seen))
        fields.append(strain_field(seen, chosen))
    for name in ("exx", "eyy", "exy", "e1", "direction_deg"):
        observed = np.std([getattr(mean, name) for mean in means])
        # 400 trials tell a standard deviation within 3.5 %.
        assert getattr(means[0], f"{name}_std") == pytest.approx(observed, rel=0.12)
        local = np.std([getattr(field, name) for field in fields], axis=0)
        known = np.isfinite(local)
        assert known.sum() > 90
        predicted = getattr(fields[0], f"{name}_std")
        ratio = np.sqrt(np.mean(predicted[known] ** 2) / np.mean(local[known] ** 2))
        assert ratio == pytest.approx(1, abs=0.05)
    # Taken for independent, errors that overlap would promise far too much or too little.
    apart = Noise(factors, np.eye(1), model.gradient)
    alone = mean_strain(Displacement(position, vector, valid, "px", None, apart))
    assert abs(alone.exx_std / np.std([mean.exx for mean in means]) - 1) > 0.25


@pytest.mark.parametrize("shape", [pytest.param("affine", marks=pytest.mark.long), "quadratic"])
def test_predicted_deviations_are_those_of_strains_measured_in_noisy_images(speckle, shape):
    settings = CorrelationSettings(subset_px=21, step_px=10, shape=shape)
    pattern, trials, noise = speckle(seed=41), 16, 2.0
    clean = pattern.draw(), pattern.draw(lambda x, y: (x / 1.01 - 0.3, y - 0.004 * x))
    rng, everywhere = np.random.default_rng(6), np.ones(pattern.shape, bool)
    sources = {source: [] for source in ("fit", "quadratic-fit", "shape")}
    means = []
    for _ in range(trials):
        noisy = [(image + rng.normal(0, noise, image.shape)).astype(np.float32) for image in clean]
        field = Correlator(noisy[0], everywhere, settings).correlate(noisy[1])
        raw = raw_displacement(field)
        means.append(mean_strain(raw))
        for source, fields in sources.items():
            fields.append(strain_field(raw, StrainSettings(source=source)))
    names = ("exx", "eyy", "exy")
    for fields in sources.values():
        for name in names:
            values = np.array([getattr(field, name) for field in fields])
            predicted = np.array([getattr(field, f"{name}_std") for field in fields])
            off = (values - values.mean(axis=0)) / predicted
            assert np.sqrt(np.nanmean(off**2) * trials / (trials - 1)) == pytest.approx(1, abs=0.12)
    values, predicted = (
        np.array([[getattr(m, n + end) for n in names] for m in means]) for end in ("", "_std")
    )
    # 16 trials of three components tell a standard deviation within 11 %.
    off = (values - values.mean(axis=0)) / predicted
    assert np.sqrt(np.mean(off**2) * trials / (trials - 1)) == pytest.approx(1, abs=0.3)


def test_size_of_the_gauge_has_the_scale_of_each_direction():
    assert gauge_text(61, None) == "virtual strain gauge 61 px"
    assert gauge_text(100, (0.02, 0.02)) == "virtual strain gauge 100 px (2.00 mm)"
    # a camera turned by 30° about its vertical axis sees 1/cos 30° more millimetres per pixel along x
    assert gauge_text(100, (0.02 / np.cos(np.radians(30.0)), 0.02)) == (
        "virtual strain gauge 100 px (2.31 mm × 2.00 mm)"
    )
    assert gauge_text(100, (2.8, 10.8)) == "virtual strain gauge 100 px (280 mm × 1080 mm)"
