"""Cameras that were calibrated with the same grid share what their images show of it."""

from dataclasses import dataclass, replace

import numpy as np

from dic.calibration.calibration import Calibration
from dic.calibration.grid_accuracy import KnownGrid
from dic.calibration.pinhole.camera import Pinhole
from dic.calibration.pinhole.prior import KnownCamera
from dic.calibration.plate import behind
from dic.typing import Float

_ROUNDS = 3
_UNKNOWN_FOCAL = 0.1
"""A camera whose focal length is less certain than this share looks straight at the grid."""
_FAR_PRINCIPAL, _WIDER = 0.025, 1.2
"""Share of the width by which a principal point is unexpectedly far from the middle, and by how much more of
it others may be."""
_CLEAR = 6.0
_BOW = slice(2, 5)


def of_one_grid(calibrations: tuple[Calibration, ...]) -> tuple[Calibration, ...]:
    """Return the calibrations with the deviations of the grid that all their images together show.

    An oblique camera sees a bow of the grid, a camera that looks straight at it sees scale ratio and skew.
    Each calibration is fitted again with what the others show. Calibrations of a grid without deviations,
    without a pinhole model or from files of earlier versions are returned unchanged.

    Only perspective tells the focal length of a camera that looks straight at the grid, and of a flat grid it
    sees none. A bow that is not clear would give it a focal length made of noise. So such a camera is fitted
    to a flat grid until the bow is clear.
    """
    accuracies = [calibration.fitted_to.accuracy.std for calibration in calibrations if calibration.fitted_to]
    if len(accuracies) < len(calibrations) or any(
        calibration.pinhole is None for calibration in calibrations
    ):
        return calibrations
    calibrations = _with_far_principals(calibrations)
    std = np.min(accuracies, axis=0)
    if not (std > 0).any() or _is_shared(calibrations):
        return calibrations
    first = _Information.of(KnownGrid(np.zeros(len(std)), np.diag(std**2)))
    straight = [looks_straight(pinhole_of(calibration)) for calibration in calibrations]
    current, shown = list(calibrations), [first.nothing() for _ in calibrations]
    found = first.known_grid()
    for _ in range(_ROUNDS):
        for k in sorted(range(len(current)), key=straight.__getitem__):
            others = sum((other for j, other in enumerate(shown) if j != k), first)
            known = others.known_grid()
            if straight[k] and not _clearly_bowed(known):
                known = _flat(known)
            again = current[k].on_grid(known)
            plate_mm = calibrations[k].plate_mm
            current[k] = behind(again, plate_mm) if plate_mm else again
            camera = pinhole_of(current[k])
            after = _Information.of(KnownGrid(camera.deviations, camera.deviation_covariance))
            shown[k] = after.without(_Information.of(known))
        before, found = found, sum(shown, first).known_grid()
        if found.is_close(before):
            break
    return tuple(
        replace(calibration, pinhole=pinhole_of(calibration).on_grid(found.mean, found.covariance))
        for calibration in current
    )


def _with_far_principals(calibrations: tuple[Calibration, ...]) -> tuple[Calibration, ...]:
    """Return the calibrations; a far principal point of one camera is then possible for all.

    A camera that looks straight at the grid does not see its principal point. If another camera of the same
    rig has one that is unexpectedly far from the middle of the image, such as one of a part of a sensor, its
    own is not expected near the middle either. Stated properties of a camera stay as they are.
    """
    shares = [_principal_share(calibration) for calibration in calibrations]
    farthest = max(shares)
    if farthest < _FAR_PRINCIPAL:
        return calibrations
    found = []
    for calibration, share in zip(calibrations, shares, strict=True):
        to = calibration.fitted_to
        known = KnownCamera() if to is None or to.known is None else to.known
        stated = known.principal_px is not None or known.principal_std_px is not None
        if to is None or stated or share == farthest:
            found.append(calibration)
            continue
        wider = replace(known, principal_std_px=_WIDER * farthest * to.image_shape[1])
        again = calibration.fitted_again(known=wider)
        found.append(behind(again, calibration.plate_mm) if calibration.plate_mm else again)
    return tuple(found)


def _principal_share(calibration: Calibration) -> float:
    """Return the distance of the principal point from the image's middle, as a share of its width."""
    height, width = calibration.image_shape
    away_px = pinhole_of(calibration).principal_px - [(width - 1) / 2, (height - 1) / 2]
    return float(np.abs(away_px).max()) / width


def looks_straight(camera: Pinhole) -> bool:
    """Return True if a camera looks so straight at the grid that its distance is hardly known."""
    return camera.focal_std_px > _UNKNOWN_FOCAL * camera.focal_px


def _clearly_bowed(grid: KnownGrid) -> bool:
    """Return True if the bow is at least six times as large as its uncertainty."""
    bow, covariance = grid.mean[_BOW], grid.covariance[_BOW, _BOW]
    free = np.diag(covariance) > 0
    weighted = np.linalg.solve(covariance[np.ix_(free, free)], bow[free])
    return bool(bow[free] @ weighted > _CLEAR**2)


def _flat(grid: KnownGrid) -> KnownGrid:
    mean, covariance = grid.mean.copy(), grid.covariance.copy()
    mean[_BOW] = 0
    covariance[_BOW], covariance[:, _BOW] = 0, 0
    return KnownGrid(mean, covariance)


def shared_factors(pinhole: Pinhole) -> int:
    """Return how many of the last columns of `error_factors` belong to errors of the grid."""
    return len(pinhole.deviations) if pinhole.deviation_covariance.any() else 0


def _is_shared(calibrations: tuple[Calibration, ...]) -> bool:
    first, *others = (pinhole_of(calibration).deviation_covariance for calibration in calibrations)
    return all(np.array_equal(first, other) for other in others)


def pinhole_of(calibration: Calibration) -> Pinhole:
    """Return the pinhole camera of a calibration; `ValueError` if there is none."""
    if calibration.pinhole is None:
        raise ValueError("this calibration knows no camera centre")
    return calibration.pinhole


@dataclass(frozen=True)
class _Information:
    """Knowledge of the deviations as a sum: inverse covariance M (5, 5), and M times the mean (5,)."""

    matrix: Float
    side: Float

    @classmethod
    def of(cls, grid: KnownGrid) -> "_Information":
        free, matrix = grid.free, np.zeros_like(grid.covariance)
        matrix[np.ix_(free, free)] = np.linalg.inv(grid.covariance[np.ix_(free, free)])
        return cls(matrix, matrix @ grid.mean)

    def __add__(self, other: "_Information") -> "_Information":
        return _Information(self.matrix + other.matrix, self.side + other.side)

    def without(self, other: "_Information") -> "_Information":
        return _Information(self.matrix - other.matrix, self.side - other.side)

    def nothing(self) -> "_Information":
        return self.without(self)

    def known_grid(self) -> KnownGrid:
        free, covariance = np.diag(self.matrix) > 0, np.zeros_like(self.matrix)
        covariance[np.ix_(free, free)] = np.linalg.inv(self.matrix[np.ix_(free, free)])
        return KnownGrid(covariance @ self.side, covariance)
