"""Results of runs with given strains and given corrections."""

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np

from dic.calibration.calibration import Calibration
from dic.calibration.pinhole.camera import Pinhole
from dic.correlation.field import Field
from dic.correlation.settings import CorrelationSettings
from dic.out_of_plane.correct import Corrections
from dic.out_of_plane.correction import Correction
from dic.out_of_plane.plane import Plane
from dic.out_of_plane.two_cameras import TwoCameraStep
from dic.pipeline.correction_settings import CorrectionSettings
from dic.pipeline.corrections import JointCorrections, RunCorrections
from dic.pipeline.result import CameraResult, RunResult
from dic.runfile.reader import RunInfo, RunStep
from dic.strain.measurement import Measurement, measure
from dic.targets.points import GridPoints

SIDE_PX = 120
INFO = RunInfo(
    title="A tension test",
    run_id="run-7",
    status="completed",
    status_reason="",
    start_time="2026-01-01T08:00:00+00:00",
    simulated=False,
    sample="sheet",
    thickness_mm=1.0,
    width_mm=25.0,
    gauge_length_mm=60.0,
    definition='kind = "tension"',
    configuration='[cameras.on_axis]\ndriver = "v4l2"\n\n[cameras.off_axis]\ndriver = "v4l2"\n',
    versions="offaxis 0.1.0\nnumpy 2.0",
)


@cache
def calibration() -> Calibration:
    """Return a calibration with 0.1 mm/px, upright, calibrated from pixel 10 to pixel 110 along both axes."""
    index = np.stack(np.meshgrid(np.arange(11), np.arange(11)), axis=-1).reshape(-1, 2)
    uv_px = np.column_stack([10.0 + 10.0 * index[:, 0], 110.0 - 10.0 * index[:, 1]])
    return Calibration.fit(GridPoints.on_lattice(index, uv_px, (11, 11), 1.0), (SIDE_PX, SIDE_PX))


def affine(gradient: np.ndarray, label: str) -> Measurement:
    """Return a measurement of 64 points with the displacement gradient `gradient` about the middle, y up."""
    at = np.arange(40, 80, 5)
    x, y = np.meshgrid(at - 60.0, 60.0 - at)
    u = gradient[0, 0] * x + gradient[0, 1] * y
    v_up = gradient[1, 0] * x + gradient[1, 1] * y
    warps = np.zeros((8, 8, 6))
    warps[..., 0], warps[..., 3] = u, -v_up
    ones, yes = np.ones((8, 8)), np.ones((8, 8), bool)
    iterations, status = ones.astype(np.int16), np.zeros((8, 8), np.int8)
    settings = CorrelationSettings(step_px=5)
    field = Field(at, at, warps, np.full_like(warps, 0.01), ones, iterations, status, yes, "search", settings)
    return measure(field, calibration(), label=label)


def stretch(exx: float, eyy: float) -> np.ndarray:
    """Return the displacement gradient with the given Green-Lagrange strains."""
    return np.diag([np.sqrt(1 + 2 * exx) - 1, np.sqrt(1 + 2 * eyy) - 1])


def turn(angle_deg: float, exx: float = 0.0) -> np.ndarray:
    """Return the displacement gradient of a stretch with the strain `exx`, followed by a rotation."""
    c, s = np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))
    return np.array([[c, -s], [s, c]]) @ (stretch(exx, 0.0) + np.eye(2)) - np.eye(2)


def camera(
    name: str, steps: list[RunStep], gradients: list[np.ndarray], pinhole: Pinhole | None = None
) -> CameraResult:
    """Return the result of a camera that measured the given gradients; `pinhole` gives its position."""
    measurements = [affine(g, f"step {s.index}") for g, s in zip(gradients, steps, strict=True)]
    speckle = np.random.default_rng(1).uniform(0, 255, (SIDE_PX, SIDE_PX)).astype(np.float32)
    seen = calibration() if pinhole is None else replace(calibration(), pinhole=pinhole)
    return CameraResult(name, seen, speckle, list(steps), measurements, [])


def tension_steps() -> list[RunStep]:
    loads = [
        RunStep(2 + k, "load", 2000.0 * (k + 1), 2001.5 + 2000 * k, 0.25 * (k + 1), np.nan, 10.0 * k)
        for k in range(3)
    ]
    return [*loads, RunStep(7, "displacement", 1.05, 6543.2, 1.0498, np.nan, 40.0)]


def tension_run(bias: float = 0.001, **info: Any) -> RunResult:
    """Return a run with two cameras; the off-axis camera comes first, and its εyy is too small by `bias`."""
    steps = tension_steps()
    strains = [(-0.0003 * k, 0.001 * k) for k in range(1, 5)]
    on_axis = camera("on_axis", steps, [stretch(x, y) for x, y in strains])
    aside = [stretch(x, y - bias) for x, y in strains]
    off_axis = camera("off_axis", steps, aside, Pinhole.swung(tilt_deg=30.0))
    return uncorrected("runs/tension.h5", replace(INFO, **info), [off_axis, on_axis])


def rotation_run(angle_deg: float, peak: float, **info: Any) -> RunResult:
    """Return a rotation run with two cameras.

    The off-axis camera has a false εxx: `peak` at 180°, and half of it at the other angles.
    """
    angles = [90.0, 180.0, 270.0]
    steps = [RunStep(2 + k, "rotation", a, np.nan, np.nan, a + 0.001, 10.0 * k) for k, a in enumerate(angles)]
    on_axis = camera("on_axis", steps, [turn(a) for a in angles])
    aside = [turn(a, peak * (1 if a == 180.0 else 0.5)) for a in angles]
    off_axis = camera("off_axis", steps, aside, Pinhole.swung(pan_deg=angle_deg))
    said = replace(INFO, **({"title": "A rotation test"} | info))
    return uncorrected("runs/rotation.h5", said, [on_axis, off_axis])


EVIL = '<script>alert("x")</script> & more'
STRAIGHT = "the camera looks too straight on"


def given(result: RunResult, motion: str, cameras: dict[str, Corrections], **more: Any) -> RunResult:
    """Return the run with the given corrections; for all other cameras, the correction was declined."""
    for seen in result.cameras:
        declined = [Correction.refused("none", m, STRAIGHT) for m in seen.measurements]
        cameras.setdefault(seen.camera, Corrections(declined))
    nothing: dict[str, list[str]] = {seen.camera: [] for seen in result.cameras}
    return replace(result, corrections=RunCorrections(motion, cameras, **({"findings": nothing} | more)))


def uncorrected(source: str, info: RunInfo, cameras: list[CameraResult]) -> RunResult:
    nothing = RunCorrections("free", {}, {})
    result = RunResult(source, info, CorrelationSettings(), CorrectionSettings(), cameras, nothing)
    return given(result, "free", {})


def correction(measurement: Measurement, strains: tuple[float, ...], plane: Plane) -> Correction:
    """Return a correction with the given strains, known to 3 µε, and a plane with slopes known to 0.001°."""
    mean = measurement.calibrated_mean
    assert mean is not None
    assert measurement.calibrated is not None
    exx, eyy, exy = strains
    mean = replace(mean, exx=exx, eyy=eyy, exy=exy, exx_std=3e-6, eyy_std=3e-6, exy_std=3e-6)
    std = np.array([*np.radians([0.001, 0.001]), np.nan])
    return Correction("tilt", mean, measurement.calibrated, measurement.strain_settings, plane, std)


def corrected_tension_run() -> RunResult:
    """Return a corrected tension run: one camera has an error of 2 µε in εyy, both together have none.

    At step 4, the correction of the single camera is declined. At step 7, the correction by both cameras is
    declined.

    The specimen is tilted by k · 0.02° along Y and shifted by 0.5 k µm at the k-th step.
    """
    result = tension_run()
    off_axis = result.cameras[0]
    images, both = [], {}
    for k, (step, seen) in enumerate(zip(off_axis.steps, off_axis.measurements, strict=True), 1):
        plane = Plane(0.0, float(np.tan(np.radians(0.02 * k))), 0.0005 * k)
        truth = (-0.0003 * k, 0.001 * k, 0.0)
        one = correction(seen, (truth[0], truth[1] + 2e-6, truth[2]), plane)
        images.append(one if step.index != 4 else Correction.refused("tilt", seen, f"it necks {EVIL}"))
        together = correction(seen, truth, plane)
        together = replace(together, after_std=np.array([1e-5, 1e-5, 0.00025]))
        heights_mm = np.full((8, 8), 0.0005 * k)
        both[step.index] = TwoCameraStep((together, together), together.mean, heights_mm, heights_mm)
    apart = Correction.refused("two cameras", off_axis.measurements[-1], "the cameras disagree")
    both[7] = TwoCameraStep((apart, apart), declined=apart.declined)
    return given(
        result,
        "tension",
        {"off_axis": Corrections(images)},
        findings={"off_axis": ["the specimen tilted by -0.08°"], "on_axis": []},
        joint=JointCorrections(("off_axis", "on_axis"), both, ["it moved"]),
    )


def corrected_rotation_run(angle_deg: float, peak: float, **info: Any) -> RunResult:
    """Return a corrected rotation run, in which the off-axis camera has εyy = 7 µε at 180° and else 1 µε."""
    result = rotation_run(angle_deg, peak, **info)
    off_axis = result.cameras[1]
    images = [
        correction(m, (0.0, 7e-6 if s.target == 180.0 else 1e-6, 0.0), Plane())
        for s, m in zip(off_axis.steps, off_axis.measurements, strict=True)
    ]
    return given(result, "rigid", {"off_axis": Corrections(images)})
