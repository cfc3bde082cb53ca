"""Fitted pinhole cameras, compared with the simulators' optics and with OpenCV."""

import re
from typing import Any

import cv2
import numpy as np
import pytest

from dic.calibration.pinhole.camera import Pinhole
from dic.calibration.pinhole.fit import fit_pinhole, fit_pinholes
from dic.calibration.pinhole.lens import distort, distortion_basis, distortion_jacobian, powers
from dic.calibration.pinhole.model import CameraModel
from dic.calibration.pinhole.prior import KnownCamera
from dic.errors import CalibrationError
from dic.targets.points import GridPoints
from simulators.scene.optics import PinholeCamera
from tests.dic.out_of_plane.lenses import LensView, drawn_camera

SHAPE = (900, 1000)
NOISE_PX = 0.01


def _points(count: int = 21, half_mm: float = 5.0) -> tuple[np.ndarray, np.ndarray]:
    index = np.stack(np.meshgrid(range(count), range(count)), axis=-1).reshape(-1, 2)
    return index, (index - (count - 1) / 2) * 2 * half_mm / (count - 1)


def _grid(uv_px: np.ndarray, count: int = 21) -> GridPoints:
    index, _ = _points(count)
    return GridPoints.on_lattice(index, uv_px, (count, count), 10 / (count - 1))


def _seen(camera: PinholeCamera, noise_px: float = 0.0, seed: int = 0, count: int = 21) -> GridPoints:
    _, xy = _points(count)
    uv = camera.project(np.column_stack([xy, np.zeros(len(xy))]))
    return _grid(uv + np.random.default_rng(seed).normal(0, 1, uv.shape) * noise_px, count)


def _residual_px(fitted: Pinhole, grid: GridPoints) -> float:
    return float(np.sqrt(((grid.uv_px - fitted.project(grid.xy_mm)) ** 2).sum(axis=1).mean()))


def _swung(**options: float) -> PinholeCamera:
    return PinholeCamera(SHAPE[1], SHAPE[0], **options)


@pytest.mark.parametrize("k1", [-1e-7, -1e-8, 0.0, 1e-8, 1e-7])
def test_exact_points_are_met_where_the_bicubic_map_fails(k1: float) -> None:
    camera = _swung(pan_deg=25, tilt_deg=25, k1_per_px2=k1)
    grid = _seen(camera)
    fitted = fit_pinhole(grid, SHAPE)

    assert _residual_px(fitted, grid) < 1e-6
    assert fitted.cross_validation_px < 1e-6
    assert fitted.distortion[0] == pytest.approx(k1, rel=1e-6, abs=1e-15)
    # decentring is nearly a shift of the principal point: 1e-9 is 1e-4 px at the grid's corner
    assert np.abs(fitted.distortion[1:]).max() < 1e-9
    assert fitted.centre_mm == pytest.approx(camera.centre_mm, abs=1e-3)
    assert fitted.off_axis_deg == pytest.approx(34.775, abs=1e-3)


@pytest.mark.parametrize("k1", [-1e-7, 1e-7])
def test_noisy_points_leave_no_more_than_their_noise(k1: float) -> None:
    camera = _swung(pan_deg=25, tilt_deg=25, k1_per_px2=k1)
    grid = _seen(camera, NOISE_PX)
    fitted = fit_pinhole(grid, SHAPE)

    # the points' scatter in both coordinates, less the 12 of 882 that the fit takes up, 5 % for chance
    assert _residual_px(fitted, grid) < 1.05 * NOISE_PX * np.sqrt(2)
    assert fitted.noise_px == pytest.approx(NOISE_PX, rel=0.1)
    truth = camera.project(np.column_stack([grid.xy_mm, np.zeros(grid.found)]))
    error = np.sqrt(((fitted.project(grid.xy_mm) - truth) ** 2).sum(axis=1).mean())
    # twelve of 882 degrees of freedom: √(12/441) of the noise
    assert error < 2 * NOISE_PX * np.sqrt(12 / 441)


def test_every_term_of_a_lens_that_opencv_draws_is_found() -> None:
    _, xy = _points()
    matrix = np.array([[2800, 0, 499.5], [0, 2800, 449.5], [0, 0, 1.0]])
    lens = np.array([0.3, -1.2, 2e-3, -3e-3])
    pose = cv2.Rodrigues(np.radians([0.0, 28.0, 0.0]))[0] @ np.diag([1.0, -1.0, -1.0])
    points = np.column_stack([xy, np.zeros(len(xy))])
    px, _ = cv2.projectPoints(points, cv2.Rodrigues(pose)[0], np.array([0.4, -0.2, 40.0]), matrix, lens)
    fitted = fit_pinhole(_grid(px[:, 0]), SHAPE, KnownCamera(principal_px=(499.5, 449.5)))

    assert fitted.distortion * 2800.0 ** np.array([2, 4, 1, 1]) == pytest.approx(lens, rel=1e-4)
    assert fitted.focal_px == pytest.approx(2800, rel=1e-5)
    assert fitted.centre_mm == pytest.approx(-pose.T @ [0.4, -0.2, 40.0], abs=1e-3)


def test_a_lens_gets_the_terms_that_its_images_ask_for_and_the_centre_errs_as_stated() -> None:
    for kind, terms in (("clean", {4}), ("moustache", {4, 5}), ("rest", {5, 71})):
        z = []
        for seed in range(4):
            rng = np.random.default_rng([seed, 9])
            view = LensView(drawn_camera(rng, rng.uniform(20, 45), kind), seed=seed, grid_noise_px=NOISE_PX)
            fitted = view.calibration().pinhole
            assert fitted is not None
            assert len(fitted.distortion) in terms
            z.append((fitted.centre_mm - view.camera.centre_mm) / fitted.centre_std_mm)
            # the points' noise is told apart from the misfit of the lens
            assert fitted.noise_px == pytest.approx(NOISE_PX, rel=0.15)
        assert np.abs(z).max() < 4


def test_the_slopes_of_a_lens_with_all_terms_are_those_of_its_distortion() -> None:
    rng = np.random.default_rng(3)
    lens = np.append([1e-7, -2e-13, 1e-6, -2e-6, 1e-19], rng.normal(0, 1, 66) * 300.0 ** -powers(71)[5:])
    at = rng.uniform(-350, 350, (20, 2))
    by_x, by_y = ((distort(at + step, lens) - distort(at - step, lens)) / 2e-3 for step in 1e-3 * np.eye(2))

    assert distortion_jacobian(at, lens) == pytest.approx(np.stack([by_x, by_y], axis=2), rel=1e-6, abs=1e-7)
    assert distort(at, lens) == pytest.approx(at + distortion_basis(at, 71) @ lens, rel=1e-12)


def test_k2_is_left_out_unless_it_predicts_points_better() -> None:
    grid = _seen(_swung(pan_deg=20, k1_per_px2=3e-8), NOISE_PX)

    assert fit_pinhole(grid, SHAPE).distortion[1] == 0.0
    assert fit_pinhole(grid, SHAPE, k2=True).distortion[1] != 0.0


def test_the_focal_length_is_the_less_certain_the_straighter_the_camera_looks() -> None:
    fits = {pan: fit_pinhole(_seen(_swung(pan_deg=pan), NOISE_PX), SHAPE, k2=False) for pan in (30, 10, 3, 0)}
    share = {pan: fitted.focal_std_px / fitted.focal_px for pan, fitted in fits.items()}

    assert share[30] < 0.01
    assert share[30] < share[10] < share[3] < share[0]
    # straight on nothing but what is usual tells it: known to a factor of three
    assert share[0] == pytest.approx(np.log(3), rel=0.05)
    assert fits[0].centre_std_mm[2] > 0.9 * fits[0].centre_mm[2]
    # where it points is known all the same
    assert fits[0].off_axis_deg < 3 * fits[0].off_axis_std_deg < 1.0


@pytest.mark.parametrize("known", [{"focal_px": 2800.0}, {"distance_mm": 40.0}])
def test_a_known_length_fixes_a_camera_that_looks_straight(known: dict[str, float]) -> None:
    grid = _seen(_swung(), NOISE_PX)
    fitted = fit_pinhole(grid, SHAPE, KnownCamera(**known))

    assert fitted.focal_px == pytest.approx(2800, rel=1e-4)
    assert fitted.centre_mm[2] == pytest.approx(40, rel=1e-4)
    assert fitted.centre_std_mm[2] < 0.01


def test_an_uncertain_length_is_carried_along() -> None:
    grid = _seen(_swung(), NOISE_PX)
    fitted = fit_pinhole(grid, SHAPE, KnownCamera(distance_mm=41.0, distance_std_mm=0.8))

    # 0.8 mm of 40 mm, and the same share of 2800 px
    assert fitted.centre_std_mm[2] == pytest.approx(0.8, rel=0.05)
    assert fitted.focal_std_px == pytest.approx(0.8 / 40 * 2800, rel=0.05)


@pytest.mark.parametrize(
    ("pan_deg", "k1", "known"),
    [
        pytest.param(30.0, 0.0, {}, marks=pytest.mark.extended),
        *(
            pytest.param(pan_deg, k1, {"principal_std_px": 0.0}, marks=pytest.mark.extended)
            for pan_deg, k1 in ((30.0, 1e-8), (10.0, 0.0))
        ),
    ],
)
def test_confidence_intervals_hold_the_truth_as_often_as_they_say(
    pan_deg: float, k1: float, known: dict[str, float]
) -> None:
    rng = np.random.default_rng(5)
    camera = _swung(pan_deg=pan_deg, k1_per_px2=k1)
    grid = _seen(camera, count=11)
    off_px = known.get("principal_std_px", 0.01 * SHAPE[1])
    hits = []
    for _ in range(200):
        # a principal point off the image's middle by what is said of it shifts the whole image
        moved = grid.uv_px + rng.normal(0, off_px, 2) + rng.normal(0, NOISE_PX, grid.uv_px.shape)
        fitted = fit_pinhole(_grid(moved, 11), SHAPE, KnownCamera(**known), k2=False)
        deviation = np.append(fitted.centre_mm - camera.centre_mm, fitted.focal_px - 2800)
        std = np.append(fitted.centre_std_mm, fitted.focal_std_px)
        hits.append(np.abs(deviation) <= 1.96 * std)

    coverage = np.mean(hits, axis=0)
    # 200 repetitions tell 95 % to ±1.5 %
    assert (coverage >= 0.90).all()
    assert (coverage <= 0.99).all()


def _tilted(rotation: np.ndarray, noise_px: float, seed: int) -> GridPoints:
    """Return the image points of a grid that is rotated by `rotation`, 40 mm in front of the camera."""
    _, xy = _points()
    points = np.column_stack([xy, np.zeros(len(xy))]) @ rotation.T
    px = _swung().project(points)
    return _grid(px + np.random.default_rng(seed).normal(0, noise_px, px.shape))


def test_images_of_the_tilted_grid_fix_the_focal_length_of_a_camera_that_looks_straight() -> None:
    turns = [np.zeros(3), np.radians([25.0, 0, 0]), np.radians([0, 25.0, 0]), np.radians([-18.0, -18.0, 0])]
    grids = [_tilted(cv2.Rodrigues(turn)[0], NOISE_PX, seed) for seed, turn in enumerate(turns)]
    alone = fit_pinhole(grids[0], SHAPE)
    first, *others = fit_pinholes(grids, SHAPE)

    assert alone.focal_std_px > 0.5 * alone.focal_px
    assert first.focal_std_px < 0.01 * first.focal_px
    assert abs(first.focal_px - 2800) < 3 * first.focal_std_px
    assert np.abs(first.centre_mm - [0, 0, 40]) == pytest.approx(0, abs=3 * first.centre_std_mm.max())
    assert all(other.focal_px == first.focal_px for other in others)
    # seen from the tilted grid, the camera is tilted
    assert others[0].centre_mm == pytest.approx(cv2.Rodrigues(turns[1])[0].T @ [0, 0, 40], abs=0.5)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"focal_px": 0.0}, "focal length: expected above 0 px, got 0.0 px; give --focal-px"),
        ({"focal_px": np.nan}, "focal length: expected above 0 px, got nan px"),
        ({"distance_mm": -1.0}, "working distance: expected above 0 mm, got -1.0 mm; give --distance-mm"),
        ({"distance_mm": 40.0, "distance_std_mm": -1.0}, "got -1.0 mm; give --distance-std-mm 0"),
        ({"focal_std_px": 10.0}, "only the standard deviation, 10.0 px; give --focal-px too"),
        ({"principal_px": (500.0,)}, "principal point: expected two finite numbers"),
        ({"principal_px": (500.0, np.inf)}, "principal point: expected two finite numbers"),
        ({"principal_std_px": -1.0}, "got -1.0 px; give --principal-std-px 0"),
    ],
)
def test_impossible_values_of_a_camera_are_refused(wrong: dict[str, Any], message: str) -> None:
    with pytest.raises(CalibrationError, match=re.escape(message)):
        KnownCamera(**wrong)


def test_all_impossible_values_of_a_camera_are_reported_together() -> None:
    with pytest.raises(CalibrationError) as caught:
        KnownCamera(focal_px=-1.0, distance_std_mm=2.0, principal_std_px=-3.0)

    for option in ("--focal-px", "--distance-mm", "--principal-std-px"):
        assert f"; give {option}" in str(caught.value)


def test_points_that_determine_no_camera_are_refused() -> None:
    grid = _seen(_swung())
    row = grid.index[:, 1] == 3
    lines = (21, 21)
    few = GridPoints.on_lattice(grid.index[:9], grid.uv_px[:9], lines, 0.5)
    on_a_line = GridPoints.on_lattice(grid.index[row], grid.uv_px[row], lines, 0.5)

    with pytest.raises(CalibrationError, match="9 points"):
        fit_pinhole(few, SHAPE)
    with pytest.raises(CalibrationError, match="one line"):
        fit_pinhole(on_a_line, SHAPE)


def test_values_that_the_images_contradict_are_refused() -> None:
    grid = _seen(_swung(pan_deg=30), NOISE_PX)

    # 2800 px in truth; only a principal point far off could make up for it
    with pytest.raises(CalibrationError, match=r"principal point's x that is \d+ standard deviations off"):
        fit_pinhole(grid, SHAPE, KnownCamera(focal_px=2500.0))
    with pytest.raises(CalibrationError, match="standard deviations off"):
        fit_pinhole(grid, SHAPE, KnownCamera(distance_mm=45.0, distance_std_mm=0.1))


@pytest.mark.parametrize(("focal_px", "distance_mm"), [(600.0, 9.0), (20000.0, 286.0), (200000.0, 2860.0)])
def test_wide_angle_and_nearly_telecentric_lenses_are_fitted(focal_px: float, distance_mm: float) -> None:
    grid = _seen(_swung(pan_deg=30, focal_px=focal_px, distance_mm=distance_mm), NOISE_PX)
    fitted = fit_pinhole(grid, SHAPE)

    assert abs(fitted.focal_px - focal_px) < 3 * fitted.focal_std_px
    assert fitted.cross_validation_px == pytest.approx(NOISE_PX * np.sqrt(2), rel=0.1)
    assert fitted.off_axis_deg == pytest.approx(30, abs=0.01)


def test_the_slopes_that_the_fit_follows_are_those_of_the_model() -> None:
    _, xy = _points(5)
    start = cv2.Rodrigues(np.radians([10.0, -25.0, 3.0]))[0]
    model = CameraModel([xy, xy[:9]], [start, start.T], 350.0, np.array([5.0, 4.0]))
    lens = [np.log(2800.0), 500.0, 450.0, 0.02, -0.004, 3e-4, -2e-4]
    poses = [0.2, -0.1, 0.3, 12.0, -8.0, np.log(70.0), -0.3, 0.1, 0.0, -5.0, 9.0, np.log(65.0)]
    at = np.array([*lens, *poses, 1e-3, -2e-3, 0.02, -0.03, 0.04])
    steps = 1e-6 * np.maximum(np.abs(at), 1.0)
    moved = [(model.project(at + step)[0] - model.project(at - step)[0]) for step in np.diag(steps)]
    shifted = [model.camera(at + step, 1)[2] - model.camera(at - step, 1)[2] for step in np.diag(steps)]
    slopes = model.camera(at, 1)[3]
    others = [*range(7), 10, 11, 12]

    assert model.project(at)[1] == pytest.approx(np.array(moved).T / (2 * steps), rel=1e-5, abs=1e-5)
    # the turn itself has no value to differ: it is seen in the centre, which turns with it
    assert slopes[others] == pytest.approx((np.array(shifted).T / (2 * steps))[others], rel=1e-5, abs=1e-6)


@pytest.mark.long
@pytest.mark.parametrize("pan_deg", [0.0, 5.0, 10.0, 20.0, 30.0, 45.0])
@pytest.mark.parametrize("images", [1, 3])
def test_confidence_intervals_hold_at_every_angle_with_one_image_and_with_three(
    pan_deg: float, images: int
) -> None:
    rng = np.random.default_rng(7)
    camera = _swung(pan_deg=pan_deg)
    _, xy = _points()
    flat = np.column_stack([xy, np.zeros(len(xy))])
    turns = [cv2.Rodrigues(np.radians(turn))[0] for turn in ([0.0, 0, 0], [20.0, 0, 0], [0, 20.0, 0])]
    exact = [camera.project(flat @ turn.T) for turn in turns[:images]]
    # one image of a camera that looks straight knows the distance only if it is given
    given = {"distance_mm": 40.0, "distance_std_mm": 0.5} if images == 1 else {}
    hits = []
    for _ in range(400):
        off = rng.normal(0, 0.01 * SHAPE[1], 2)
        grids = [_grid(px + off + rng.normal(0, NOISE_PX, px.shape)) for px in exact]
        known = dict(given)
        if known:
            known["distance_mm"] = 40.0 + rng.normal(0, 0.5)
        fitted = fit_pinholes(grids, SHAPE, KnownCamera(**known), k2=False)[0]
        deviation = np.append(fitted.centre_mm - camera.centre_mm, fitted.focal_px - 2800)
        hits.append(np.abs(deviation) <= 1.96 * np.append(fitted.centre_std_mm, fitted.focal_std_px))

    coverage = np.mean(hits, axis=0)
    assert (coverage >= 0.92).all()
    assert (coverage <= 0.98).all()
