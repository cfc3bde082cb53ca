"""The tables and formulas of docs/kernel.md are evaluated pixel by pixel and compared with the kernel."""

import re
from fractions import Fraction
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.ndimage import map_coordinates

from dic.correlation import kernel
from dic.correlation.kernel import icgn, moments, sums, warps
from dic.correlation.kernel.jit import compiled
from dic.correlation.kernel.method import Subset
from dic.correlation.kernel.prepared import prepare, recall
from dic.correlation.kernel.records import FACTORS, FX_FX, MEAN, NORM2, record_length
from dic.correlation.kernel.uncertainty import write_std
from dic.correlation.kernel.workspace import Workspace
from dic.correlation.settings import CorrelationSettings
from dic.correlation.solver import method_of
from dic.image.spline import halfway_noise_gain, slope_noise_gain, spline_image
from dic.image.stored import StoredImage
from tests.places import DOCS

RADIUS = 10
"""Half-width of the subset: a row needs a vector of 16 pixels and one of 8, which exceeds the subset."""

CENTRE = 40, 33
WARP = np.array([0.31, 0.012, -0.02, -0.44, 0.015, 0.008, 4e-4, -3e-4, 2e-4, -5e-4, 3e-4, 1e-4])
SIDES = ["fx", "fy"]


def tables(heading):
    """Return the tables of docs/kernel.md whose first heading is `heading`, as lists of rows of cells."""
    found, rows = [], None
    for line in (DOCS / "kernel.md").read_text(encoding="utf-8").splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if not line.startswith("|"):
            rows = None
        elif cells[0] == heading:
            rows = []
            found.append(rows)
        elif rows is not None and set(line) - set("|- "):
            rows.append(cells)
    return found


MONOMIALS = [(int(a), int(b)) for a, b in zip(*(row[1:] for row in tables("k")[0]), strict=True)]
PARAMETERS = [(row[2], int(row[3]), int(row[4]), float(Fraction(row[5]))) for row in tables("i")[0]]
OF_REFERENCE, WITH_IMAGE = tables("name in `sums.py`")


@pytest.fixture(
    scope="module",
    params=[
        # Its own machine code takes seconds to compile; `test_icgn.py` compares affine warps with NumPy, too.
        pytest.param(("affine", 3), marks=pytest.mark.extended, id="affine"),
        pytest.param(("quadratic", 5), id="quadratic"),
    ],
)
def pixels(speckle, request):
    """A subset whose right columns lie outside the region, in the forms for the kernel and for NumPy."""
    pattern, (shape, order) = speckle(seed=81, shape=(70, 80), noise=1.0), request.param
    images = pattern.draw(noise_seed=1), pattern.draw(lambda x, y: (x - 0.3, y + 0.4), noise_seed=2)
    region = np.ones(pattern.shape, bool)
    region[:, CENTRE[0] + 8 :] = False
    reference = spline_image(images[0], order)
    dy, dx = np.mgrid[-RADIUS : RADIUS + 1, -RADIUS : RADIUS + 1]
    inside = region[CENTRE[1] + dy, CENTRE[0] + dx]
    row, column = CENTRE[1] + dy[inside], CENTRE[0] + dx[inside]
    slopes, mean = reference.gradient(), float(images[0].mean())
    return SimpleNamespace(
        settings=CorrelationSettings(2 * RADIUS + 1, shape=shape, order=order),
        image=kernel.lay_reference(reference, region, mean),
        deformed=kernel.lay_deformed(StoredImage(images[1]), order, mean),
        subset=Subset(*CENTRE, RADIUS, int(inside.sum())),
        grey=images[1].astype(float) - mean,
        x=dx[inside].astype(float),
        y=dy[inside].astype(float),
        f=images[0][row, column].astype(float) - mean,
        fx=slopes[0][row, column].astype(float),
        fy=slopes[1][row, column].astype(float),
    )


@pytest.fixture
def point(pixels):
    """The subset's data prepared by the kernel, and its steepest-descent images computed by NumPy."""
    parameters = pixels.settings.parameters
    method, work = method_of(pixels.settings), Workspace.for_subsets(RADIUS, parameters)
    record = np.full(record_length(parameters), np.nan, np.float32)
    run_prepare(pixels.image, method.shape, pixels.subset, work, record)
    J = [factor * getattr(pixels, side) * pixels.x**a * pixels.y**b for side, a, b, factor in PARAMETERS]
    return SimpleNamespace(
        method=method,
        work=work,
        record=record,
        p=WARP[:parameters],
        J=np.stack(J[:parameters], axis=1),
        f_centred=pixels.f - pixels.f.mean(),
    )


@compiled
def run_prepare(image, shape, subset, work, record):
    prepare(image, shape, subset, work, record)
    recall(record, work)


@compiled
def run_moments_with_image(image, deformed, method, subset, p, work, smooth):
    smooth[0] = warps.is_smooth(p, subset.radius)
    moments.moments_with_image(
        image, deformed, method.taps, method.shape, subset, p, smooth[0], work.rows, work.S
    )


@compiled
def run_compare(record, subset, work, found):
    found[0], found[1] = icgn._compare(record, subset, work)


@compiled
def run_write_std(record, method, subset, p, zncc, work, std):
    write_std(record, work.H, method, subset, p, zncc, work.d, std)


def seen(pixels, p):
    """Return the grey levels of the deformed image at the warped pixels, interpolated by SciPy's spline."""
    at = [CENTRE[0] + pixels.x, CENTRE[1] + pixels.y]
    for parameter, (side, a, b, factor) in zip(p, PARAMETERS, strict=False):
        at[SIDES.index(side)] += parameter * factor * pixels.x**a * pixels.y**b
    return map_coordinates(pixels.grey, at[::-1], order=pixels.settings.order, mode="mirror")


def places(row):
    """Return first index, last k and factors from a row of a table of moments in docs/kernel.md."""
    name, offset = re.fullmatch(r"`(\w+)`(?: \+ (\d+))?", row[0]).groups()
    first = int(row[1].removesuffix("+ k"))
    assert getattr(sums, name) + int(offset or 0) == first
    return first, int(row[2]), row[3].removeprefix("∑ ").split()


def check_moments(found, rows, values, degree, tolerance):
    """Compare the kernel's moments with sums over pixels by their table; unused moments must be 0."""
    expected, sizes = np.full(len(found), np.nan), np.zeros(len(found))
    for row in rows:
        first, last, factors = places(row)
        product = np.prod([values[name] for name in factors if name != "m"], axis=0)
        slopes = sum(name in SIDES for name in factors)
        for k, (a, b) in enumerate(MONOMIALS[: last + 1]):
            terms = product * (values["x"] ** a * values["y"] ** b if "m" in factors else 1.0)
            assert np.isnan(expected[first + k])
            expected[first + k] = terms.sum() if a + b <= slopes * degree else 0.0
            sizes[first + k] = np.abs(terms).sum()
    assert np.isfinite(expected).all()
    assert (np.abs(found - expected) <= tolerance * sizes).all()


def degree_of(point):
    return 1 if len(point.p) == 6 else 2


def test_the_table_of_parameters_is_that_of_the_code():
    sides, a, b, factors = zip(*PARAMETERS, strict=True)
    np.testing.assert_array_equal(warps.SIDE, [SIDES.index(side) for side in sides])
    np.testing.assert_array_equal(warps.POWER_X, a)
    np.testing.assert_array_equal(warps.POWER_Y, b)
    np.testing.assert_array_equal(warps.FACTOR, factors)


def test_monomials_are_counted_as_the_page_says():
    assert [(a + b) * (a + b + 1) // 2 + b for a, b in MONOMIALS] == list(range(15))
    assert [warps.monomial.__wrapped__(a, b) for a, b in MONOMIALS] == list(range(15))


@pytest.mark.extended
def test_moments_of_the_reference_are_the_sums_of_the_table(pixels, point):
    check_moments(point.work.Q, OF_REFERENCE, vars(pixels), degree_of(point), tolerance=2e-6)


@pytest.mark.extended
@pytest.mark.parametrize(("turn", "is_smooth"), [(0.0, True), (0.4, False)], ids=["smooth", "turned"])
def test_moments_with_the_deformed_image_are_the_sums_of_the_table(pixels, point, turn, is_smooth):
    p = point.p.copy()
    p[[2, 4]] += turn, -turn
    smooth = np.empty(1, np.bool_)
    run_moments_with_image(
        pixels.image, pixels.deformed, point.method, pixels.subset, p.astype(np.float32), point.work, smooth
    )
    assert smooth[0] == is_smooth
    values = vars(pixels) | {"g": seen(pixels, p)}
    # Positions are rounded to float32, too.
    check_moments(point.work.S, WITH_IMAGE, values, degree_of(point), tolerance=1e-5)


def projected_hessian(point):
    """Return the sums of (P Jᵢ)(P Jⱼ) over all pixels, with the projection P written as a matrix."""
    f, n = point.f_centred, len(point.f_centred)
    P = np.eye(n) - np.full((n, n), 1 / n) - np.outer(f, f) / (f @ f)
    return (P @ point.J).T @ (P @ point.J)


def test_the_record_of_a_point_holds_what_the_page_says(pixels, point):
    record, work, J, f = point.record, point.work, point.J, point.f_centred
    assert record[MEAN] == pytest.approx(pixels.f.mean(), rel=1e-5)
    assert record[NORM2] == pytest.approx(f @ f, rel=1e-5)
    squares = [pixels.fx @ pixels.fx, pixels.fy @ pixels.fy]
    np.testing.assert_allclose(record[FX_FX : FX_FX + 2], squares, rtol=1e-5)
    assert (np.abs(work.s - J.sum(axis=0)) <= 1e-5 * np.abs(J).sum(axis=0)).all()
    assert (np.abs(work.t - J.T @ f) <= 1e-5 * np.abs(J).T @ np.abs(pixels.f)).all()
    L, sizes = np.tril(work.H), np.linalg.norm(J, axis=0)
    scale = np.outer(sizes, sizes)
    np.testing.assert_allclose(L @ L.T / scale, projected_hessian(point) / scale, atol=1e-5)
    kept = [[work.s[i], work.t[i], *L[i, : i + 1]] for i in range(len(L))]
    np.testing.assert_array_equal(record[FACTORS:], np.concatenate(kept))


def test_the_right_hand_side_and_the_zncc_are_those_of_the_page(pixels, point):
    J, f, p = point.J, point.f_centred, point.p.astype(np.float32)
    run_moments_with_image(
        pixels.image, pixels.deformed, point.method, pixels.subset, p, point.work, np.empty(1, np.bool_)
    )
    found = np.empty(2)
    run_compare(point.record, pixels.subset, point.work, found)
    has_contrast, zncc = found
    g = seen(pixels, point.p)
    g = g - g.mean()
    gain = np.linalg.norm(f) / np.linalg.norm(g)
    residuals = gain * g - f
    assert has_contrast
    assert zncc == pytest.approx(f @ g / np.linalg.norm(f) / np.linalg.norm(g), abs=1e-5)
    assert residuals @ residuals == pytest.approx(2 * (f @ f) * (1 - zncc), rel=1e-3)
    assert (np.abs(point.work.b - J.T @ residuals) <= 1e-5 * np.abs(J).T @ np.abs(gain * g)).all()


@pytest.mark.parametrize("zncc", [0.999, 0.95, 0.5])
def test_standard_deviations_are_those_of_the_page(pixels, point, zncc):
    """Down to a ZNCC at which the slopes would be nothing but noise: there the factor is limited."""
    n, m = len(pixels.f), len(point.p)
    q, damping, offset = halfway_noise_gain(pixels.settings.order), 1.0, np.linspace(-RADIUS, RADIUS, 801)
    for u, u_x, u_y in (point.p[:3], point.p[3:6]):
        cosine = np.cos(2 * np.pi * (u + u_x * offset + u_y * offset[:, None])).mean()
        damping *= (1 + q) / 2 + (1 - q) / 2 * cosine
    noise2 = 2 * (point.f_centred @ point.f_centred) * (1 - zncc) / ((n - m - 2) * (1 + damping))
    expected = np.sqrt(2 * noise2 * np.diag(np.linalg.inv(projected_hessian(point))))[:6]
    for side, slope in enumerate((pixels.fx, pixels.fy)):
        apparent, added = slope @ slope, n * slope_noise_gain(pixels.settings.order) * noise2
        expected[3 * side : 3 * side + 3] *= min(5, apparent / (apparent - added)) if added < apparent else 5
    std = np.empty(6)
    run_write_std(point.record, point.method, pixels.subset, point.p, zncc, point.work, std)
    np.testing.assert_allclose(std, expected, rtol=2e-3)
