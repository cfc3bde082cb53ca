"""States of a moving surface between two states, and the mean of a picture over an exposure."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import ceil

import numpy as np

from simulators.scene.optics import PinholeCamera
from simulators.scene.pose import Pose
from simulators.scene.scene import Surface

STILL_PX = 0.1
"""A motion of this length during an exposure smooths a speckle pattern by less than 0.01 %."""
MOMENTS_MAX = 128


@dataclass(frozen=True)
class Look:
    """What a camera saw at a time, in seconds on the rig's clock."""

    time_s: float
    surface: Surface


def between(first: Surface, second: Surface, part: float) -> Surface:
    """Return the surface at the part (0 to 1) of a steady motion from one state to another.

    Parts below 0 and above 1 continue the motion. Both surfaces have the same
    texture, and both or none have a band.
    """
    step = second.pose.rotation @ first.pose.rotation.T
    axis = np.array([step[2, 1] - step[1, 2], step[0, 2] - step[2, 0], step[1, 0] - step[0, 1]])
    sine, cosine = np.linalg.norm(axis) / 2, (np.trace(step) - 1.0) / 2
    pose = first.pose
    if sine > 0.0:
        angle_deg = float(np.degrees(np.arctan2(sine, cosine))) * part
        pose = Pose(Pose.turned(axis, angle_deg, np.zeros(3)).rotation @ pose.rotation)
    band = first.band
    if band is not None and second.band is not None:
        band = replace(
            band,
            front_mm=band.front_mm + part * (second.band.front_mm - band.front_mm),
            elastic=band.elastic + part * (second.band.elastic - band.elastic),
            elastic_across=band.elastic_across + part * (second.band.elastic_across - band.elastic_across),
        )
    rate = second.pose.translation_mm - first.pose.translation_mm
    stretch = second.deformation_gradient - first.deformation_gradient
    return replace(
        first,
        pose=Pose(pose.rotation, first.pose.translation_mm + part * rate),
        deformation_gradient=first.deformation_gradient + part * stretch,
        shift_mm=first.shift_mm + part * (second.shift_mm - first.shift_mm),
        load_n=first.load_n + part * (second.load_n - first.load_n),
        displacement_mm=first.displacement_mm + part * (second.displacement_mm - first.displacement_mm),
        band=band,
    )


def moments(camera: PinholeCamera, looks: Sequence[Look], exposure_s: float) -> list[tuple[float, Surface]]:
    """Return surfaces whose pictures have the mean of the exposure as their mean, each with its share.

    Parameters
    ----------
    camera : PinholeCamera
    looks : sequence of Look
        What the camera saw at the start, in the middle and at the end of the exposure. The time of the middle
        one is the middle of the exposure. If the others are late, the motion is taken as steady.
    exposure_s : float

    Returns
    -------
    list of (float, Surface)
        The middle alone if the picture moves by less than `STILL_PX`, or if there is no steady motion because
        the grid is attached, a tear opens or a band begins. Otherwise the points of Gauss'
        quadrature, which are so many that they are less than a pixel apart, at most `MOMENTS_MAX`.
    """
    start, middle, end = looks
    same = _alike(start.surface, middle.surface) and _alike(middle.surface, end.surface)
    length_px = motion_px(camera, start.surface, end.surface) if same else 0.0
    # A machine that turns back in the middle comes to where it was: see the way to the middle as well.
    length_px = max(length_px, motion_px(camera, start.surface, middle.surface) if same else 0.0)
    if length_px <= STILL_PX:
        return [(1.0, middle.surface)]
    nodes, weights = np.polynomial.legendre.leggauss(min(1 + ceil(length_px), MOMENTS_MAX))
    found: list[tuple[float, Surface]] = []
    for node, weight in zip(nodes, weights, strict=True):
        off_s = node * exposure_s / 2
        other = start if node < 0.0 else end
        span_s = other.time_s - middle.time_s
        part = off_s / span_s if span_s else 0.0
        found.append((float(weight) / 2, between(middle.surface, other.surface, part)))
    return found


def _alike(first: Surface, second: Surface) -> bool:
    """Return True if a steady motion leads from one surface to the other."""
    return first.texture == second.texture and (first.band is None) == (second.band is None)


def motion_px(camera: PinholeCamera, first: Surface, second: Surface) -> float:
    """Return the longest way in px that the picture's corners and middle move between two states."""
    right, bottom = camera.width_px - 1.0, camera.height_px - 1.0
    px = np.array([[0.0, 0.0], [right, 0.0], [0.0, bottom], [right, bottom], [right / 2, bottom / 2]])
    moved = camera.project(second.world(first.material(*camera.ray(px))))
    return float(np.max(np.linalg.norm(moved - px, axis=1)))
