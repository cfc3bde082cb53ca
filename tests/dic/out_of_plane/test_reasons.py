"""If a correction is refused, the stated reason is the simulated cause."""

import numpy as np
import pytest

from dic.out_of_plane.rigidity import correct_rotation
from dic.out_of_plane.shift import Shift
from dic.out_of_plane.tension import correct_tilt
from simulators.scene.optics import PinholeCamera
from simulators.scene.pose import Pose
from tests.dic.out_of_plane.exact_views import OffCentre, State, View

NU = 0.33
TURNS_DEG = np.arange(1, 6) * 60.0


def direction(rng):
    angle = rng.uniform(0.0, 2 * np.pi)
    return np.array([np.cos(angle), np.sin(angle)])


def viewed(rng, half_mm):
    pan_deg, tilt_deg = 30 * direction(rng)
    camera = OffCentre(PinholeCamera(800, 800, pan_deg=pan_deg, tilt_deg=tilt_deg), rng.normal(0.0, 8.0, 2))
    return View(camera, half_mm=half_mm, seed=int(rng.integers(1 << 30)))


def bending(rng):
    x, y = direction(rng)
    per_mm = rng.choice([-1, 1]) * 1e-3 / rng.uniform(0.3, 1.0)
    return State(F=np.diag([0.999, 1.002]), curvatures=(per_mm * x * x, per_mm * x * y, per_mm * y * y))


def grading(rng):
    strain, per_mm = rng.uniform(0.003, 0.005), rng.choice([-1, 1]) * rng.uniform(0.6, 1.0) / 4.2

    def within(p):
        x, y = p.T
        along = y + per_mm * (y * y / 2 - (2 + NU) / 2 * x * x)
        return np.column_stack([x - NU * strain * (x + per_mm * x * y), y + strain * along])

    return State(within=within)


def necking(rng):
    width_mm, at_mm, strain = rng.uniform(0.8, 1.6), rng.uniform(-1.5, 1.5), rng.uniform(0.01, 0.03)

    def within(p):
        x, y = p[:, 0], (p[:, 1] - at_mm) / width_mm
        return np.column_stack(
            [x * (1 - strain / 2 / np.cosh(y) ** 2), p[:, 1] + strain * width_mm * np.tanh(y)]
        )

    return State(within=within)


def sliding(rng):
    way_mm = rng.uniform(1.2, 1.6) * direction(rng)
    return State(F=np.diag([0.9995, 1.0015]), within=lambda p: p + way_mm)


def in_grips(plant, rng):
    """Return the stated reason for a specimen whose constant tilt already exists in the reference."""
    view, mounted = viewed(rng, 3.2), Pose.sloped(*rng.normal(0.0, 0.05, 2))
    state, calibration = plant(rng), view.calibration()
    loaded = State(mounted, state.F, state.within)
    (seen,) = view.measurements([loaded], calibration, State(mounted))
    return correct_tilt(seen, calibration, NU, Shift(1.0)).declined


def turning_camera(rng):
    return rng.uniform(0.35, 0.7) * direction(rng)


def with_a_moved_camera(plant, rng):
    """Return the stated reason for a camera that turns about its own centre."""
    view = viewed(rng, 3.2)
    x_deg, y_deg = plant(rng)
    turned = Pose.turned(np.array([y_deg, -x_deg, 0.0]), np.hypot(x_deg, y_deg), view.camera.centre_mm)
    roll = Pose.turned(view.camera.centre_mm, rng.normal(0.0, 0.1), view.camera.centre_mm)
    calibration = view.calibration()
    (seen,) = view.measurements([State(turned.after(roll), np.diag([0.9995, 1.0015]))], calibration)
    return correct_tilt(seen, calibration, NU, Shift(1.0)).declined


def in_tension(plant, rng):
    view = viewed(rng, 4.2)
    tilt = Pose.sloped(*(0.1 * direction(rng)))
    state, calibration = plant(rng), view.calibration()
    (seen,) = view.measurements([State(tilt, state.F, state.within, state.curvatures)], calibration)
    return correct_tilt(seen, calibration, NU, Shift(1.0)).declined


def wandering(rng):
    wander_deg = rng.uniform(0.03, 0.1)
    for turn_deg in TURNS_DEG:
        axis = np.array([*np.tan(np.radians(rng.normal(0.0, wander_deg, 2))), 1.0])
        yield State(Pose.turned(axis, turn_deg, np.zeros(3)))


def straining(rng):
    for turn_deg in TURNS_DEG:
        strain = rng.uniform(-1e-3, 1e-3)
        yield State(
            Pose.turned(np.array([0.0, 0.0, 1.0]), turn_deg, np.zeros(3)),
            np.diag([1 - NU * strain, 1 + strain]),
        )


def in_rotation(plant, rng):
    view = viewed(rng, 3.4)
    calibration = view.calibration()
    seen = view.measurements(list(plant(rng)), calibration)
    return correct_rotation(seen, calibration).corrections[0].declined


PLANTED = {
    bending: (in_tension, "bends out of its plane"),
    grading: (in_tension, "gradient along the specimen"),
    necking: (in_tension, "neck"),
    sliding: (in_grips, "specimen slid"),
    turning_camera: (with_a_moved_camera, "camera turned"),
    wandering: (in_rotation, "axis wandered"),
    straining: (in_rotation, "not rigid"),
}


@pytest.mark.parametrize("plant", PLANTED)
def test_the_planted_cause_is_named(plant):
    observe, words = PLANTED[plant]
    assert words in observe(plant, np.random.default_rng(1))


def test_a_strong_tilt_in_the_grips_is_no_moved_camera():
    view = viewed(np.random.default_rng(4), 3.2)
    calibration = view.calibration()
    # The specimen tilts about its grip, and slides along itself by as much as the crosshead moves.
    hung = Pose.turned(np.array([1.0, 0.0, 0.0]), 0.5, np.array([0.0, -30.0, 0.0]))
    state = State(hung, np.diag([0.9995, 1.0015]), lambda p: p + np.array([0.0, 0.05]))
    (seen,) = view.measurements([state], calibration)
    assert correct_tilt(seen, calibration, NU, Shift(30.0, (0.0, -30.0))).declined is None


@pytest.mark.long
def test_the_reason_is_right_in_nineteen_of_twenty_cases():
    right, declined = 0, 0
    for plant, (observe, words) in PLANTED.items():
        reasons = [observe(plant, np.random.default_rng([2, seed])) for seed in range(50)]
        named = [reason for reason in reasons if reason is not None]
        hits = sum(words in reason for reason in named)
        print(f"\n{plant.__name__}: {len(named)} declined, {hits} named rightly", end="", flush=True)
        right, declined = right + hits, declined + len(named)
    assert declined >= 200
    assert right >= 0.95 * declined
