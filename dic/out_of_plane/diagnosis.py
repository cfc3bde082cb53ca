"""Diagnosis of a test set-up from its false strain: sensitivity of cameras, misalignments and remedies."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dic.calibration.calibration import Calibration
from dic.out_of_plane.alignment import Alignment
from dic.out_of_plane.correction import Correction
from dic.typing import Float

_HARMONICS = 5
_CLEAR = 3.0
"""A misalignment of more than this many standard deviations is reported."""

_WORTH_DEG = 0.01
_MICRO = 1e6


@dataclass(frozen=True)
class Sensitivity:
    """The false strain that a camera measures when a specimen moves out of the grid's plane.

    Attributes
    ----------
    off_axis_deg : float
        Angle between the grid's normal and the line from the grid's centre to the camera's centre.
    per_mdeg : float
        False strain that a tilt of the specimen by 0.001° causes. Tilt and false strain are in the direction
        in which the camera is tilted.
    per_um, per_um_std : float
        False isotropic strain for a shift of 1 µm towards the camera, and the standard deviation of this
        strain.
    per_mdeg_turned : float
        False strain if the camera turns by 0.001° about its own centre: twice that of a tilt in the direction
        in which the camera is tilted, and once across it.
    """

    off_axis_deg: float
    per_mdeg: float
    per_um: float
    per_um_std: float
    per_mdeg_turned: float

    @classmethod
    def of(cls, calibration: Calibration) -> "Sensitivity | None":
        """Return the sensitivity of a calibrated camera, or None if the camera's centre is unknown."""
        if calibration.pinhole is None:
            return None
        x, y, z = calibration.pinhole.centre_mm
        tangent = float(np.hypot(x, y) / z)
        per_um = 1e-3 / float(z)
        per_um_std = per_um * float(calibration.pinhole.centre_std_mm[2] / z)
        per_mdeg = tangent * np.radians(1e-3)
        return cls(float(np.degrees(np.arctan(tangent))), per_mdeg, per_um, per_um_std, 2.0 * per_mdeg)

    @property
    def text(self) -> str:
        """The sensitivity of the camera to out-of-plane motion, as one line of text."""
        return (
            f"{self.off_axis_deg:.1f}° off-axis: {_MICRO * self.per_mdeg:.1f} µε per millidegree of tilt, "
            f"{_MICRO * self.per_mdeg_turned:.1f} µε per millidegree that the camera turns, "
            f"{_MICRO * self.per_um:.1f} ± {_MICRO * self.per_um_std:.1f} µε per µm towards the camera"
        )


@dataclass(frozen=True)
class Harmonics:
    """Strain as a function of the rotation angle φ: c₀ + c₁ cos φ + s₁ sin φ + c₂ cos 2φ + s₂ sin 2φ.

    The strain is given in the grid's axes, which do not rotate. A wobble of the specimen changes the strain
    once per turn. A grid that is tilted relative to the specimen changes the strain twice per turn.
    """

    coefficients: Float
    """Shape (5, 3). The coefficients c₀, c₁, s₁, c₂, s₂ in the rows, for exx, eyy and exy in the columns."""

    @classmethod
    def of(cls, angles_deg: Float, strains: Float) -> "Harmonics | None":
        """Fit the harmonics by least squares; return None if the angles do not determine the coefficients.

        `angles_deg`, shape (n,): rotation of the specimen since the reference image. `strains`, shape (n, 3):
        strains exx, eyy and exy in axes that rotate with the specimen. NaN for unknown strains.
        """
        known = np.isfinite(strains).all(axis=1) & np.isfinite(angles_deg)
        phi, standing = np.radians(angles_deg[known]), in_grid_axes(angles_deg[known], strains[known])
        waves = [np.cos(phi), np.sin(phi), np.cos(2 * phi), np.sin(2 * phi)]
        design = np.column_stack([np.ones(len(phi)), *waves])
        if len(design) < _HARMONICS or np.linalg.cond(design) > 1e3:
            return None
        return cls(np.linalg.lstsq(design, standing, rcond=None)[0])

    @property
    def amplitudes(self) -> Float:
        """Amplitudes of the first and of the second harmonic, for exx, eyy and exy, shape (2, 3)."""
        c1, s1, c2, s2 = self.coefficients[1:]
        return np.array([np.hypot(c1, s1), np.hypot(c2, s2)])


def in_grid_axes(angles_deg: Float, strains: Float) -> Float:
    """Transform strains from the axes of the rotating specimen to the fixed axes of the grid: R E Rᵀ.

    `strains`, shape (k, 3): strains εxx, εyy and εxy in any unit. `angles_deg` has the shape (k,).
    """
    c, s = np.cos(np.radians(angles_deg)), np.sin(np.radians(angles_deg))
    turns = np.stack([np.stack([c, -s], -1), np.stack([s, c], -1)], -2)
    exx, eyy, exy = strains.T
    tensors = np.stack([np.stack([exx, exy], -1), np.stack([exy, eyy], -1)], -2)
    standing = turns @ tensors @ turns.transpose(0, 2, 1)
    return np.stack([standing[:, 0, 0], standing[:, 1, 1], standing[:, 0, 1]], axis=-1)


def rotation_findings(harmonics: Harmonics | None, alignment: Alignment | None) -> list[str]:
    """Return sentences about the alignment of stage, specimen and grid, with remedies."""
    findings = []
    if harmonics is not None:
        first, second = _MICRO * harmonics.amplitudes.max(axis=1)
        findings.append(
            f"false strain varies by ±{first:.0f} µε once a turn (a wobbling specimen) "
            f"and by ±{second:.0f} µε twice a turn (a grid tilted against the specimen)"
        )
    if alignment is None:
        return findings
    grid_std_deg = np.degrees(np.sqrt(np.diag(alignment.covariance)[:2]))
    for what, slopes, std, remedy in (
        (
            "the stage's axis leans off the specimen's normal",
            alignment.wobble_deg,
            alignment.wobble_std_deg,
            "shim the specimen's holder on the stage",
        ),
        (
            "the specimen is tilted against the grid's plane",
            np.degrees(np.arctan(alignment.slopes[:2])),
            grid_std_deg,
            "attach the grid flat on the specimen's own surface",
        ),
    ):
        if _is_clear(slopes, std):
            findings.append(
                f"{what} by {_slopes_text(slopes, std)}: {remedy}, "
                "or apply this alignment to other runs on the same fixture"
            )
    return findings


def tension_findings(corrections: Sequence[Correction], loads_n: Float) -> list[str]:
    """Return sentences about the specimen's tilt and shift under load, with remedies."""
    applied = [
        (load_n, c.after, c.after_std)
        for load_n, c in zip(loads_n, corrections, strict=True)
        if c.declined is None and c.after is not None and c.after_std is not None and np.isfinite(load_n)
    ]
    if not applied:
        return []
    slopes = np.degrees(np.arctan([[plane.slope_x, plane.slope_y] for _, plane, _ in applied]))
    stds = np.degrees([std[:2] for _, _, std in applied])
    clear = [k for k in range(len(applied)) if _is_clear(slopes[k], stds[k])]
    if not clear:
        return ["no clear tilt of the specimen was found while it was loaded"]
    at = max(clear, key=lambda k: float(np.hypot(*slopes[k])))
    finding = (
        f"the specimen tilted by {_slopes_text(slopes[at], stds[at])} (largest, at {applied[at][0]:.0f} N): "
        "take the reference at a small preload, once the grips have straightened it"
    )
    shifts = [(1e3 * p.shift_mm, 1e3 * s[2]) for _, p, s in applied if np.isfinite(s[2])]
    return [finding, _shift_text(shifts)] if shifts else [finding]


def contraction_findings(corrections: Sequence[Correction]) -> list[str]:
    """Return a sentence if the lateral contraction of the specimen contradicts the expected shift."""
    shown = [c.uncertainty for c in corrections if c.uncertainty and "contraction_um" in c.uncertainty]
    clear = [each for each in shown if each.get("contraction_contradicts")]
    if not clear:
        return []
    worst = max(clear, key=lambda each: abs(each["contraction_um"]))
    return [
        f"the lateral contraction contradicts the expected shift in {len(clear)} of {len(shown)} images: "
        f"it shows a shift of up to {worst['contraction_um']:+.0f} ± {worst['contraction_std_um']:.0f} µm "
        "towards the camera, which the standard deviations now contain: check grips, thickness and "
        "Poisson's ratio, or measure the shift with a second camera"
    ]


def _shift_text(shifts_um: Sequence[tuple[float, float]]) -> str:
    """Return a text about the shift of the specimen towards the camera.

    Each element of `shifts_um` holds the shift of a step and its standard deviation, µm.
    """
    if all(abs(shift) <= _CLEAR * std for shift, std in shifts_um):
        return f"it kept its distance from the camera to ± {max(std for _, std in shifts_um):.1f} µm"
    moved = [shift for shift, _ in shifts_um]
    return f"it moved by {min(moved):+z.1f} to {max(moved):+z.1f} µm towards the camera"


def _is_clear(slopes_deg: Float, std_deg: Float) -> bool:
    return bool(((np.abs(slopes_deg) > _CLEAR * std_deg) & (np.abs(slopes_deg) > _WORTH_DEG)).any())


def _slopes_text(slopes_deg: Float, std_deg: Float) -> str:
    parts = [
        f"{slope:+z.4f}° ± {std:.4f}° along {axis}"
        for slope, std, axis in zip(slopes_deg, std_deg, "XY", strict=True)
    ]
    return " and ".join(parts)
