"""Checks that the maps of a result file belong together, before any of their values is used."""

from collections.abc import Iterable
from typing import Any

from dic.strain.strain import IMAGES_KEYS, STRAIN_KEYS

_MAPS = (
    "u_px", "v_px", "gradient", "std_u_px", "std_v_px", "std_gradient", "noise_std_px", "bias_u_px",
    "bias_v_px", "zncc", "status", "iterations", "U_mm", "V_mm", "valid", *STRAIN_KEYS, *IMAGES_KEYS,
)  # fmt: skip
"""Datasets with a value per image, row and column of the point grid."""

_OF_GRID = ("active", "subset_pixels", "subset_cut", "X_mm", "Y_mm")
"""Datasets with a value per row and column of the point grid."""

_OF_IMAGE = ("region", "usable")
"""Datasets with a value per pixel of the reference image."""


class Contradiction(Exception):
    """Two datasets of a result file exclude each other; the text names the dataset that differs."""


def require_shapes(series: Any, reference: Any, joint: Any = None) -> None:
    """Check the maps of a series against its point grid, and its masks against the reference image.

    Only shapes are read, no values.

    `series`: group of the file that `ResultWriter.add` wrote. `joint`: group of the same camera that
    `ResultWriter.add_two_cameras` wrote.

    Raises a `Contradiction` that names the first dataset of another shape.
    """
    grid = (len(series["y_px"]), len(series["x_px"]))
    corrected = [
        group["corrected"] for group in (series, joint) if group is not None and "corrected" in group
    ]
    for group in (series, *corrected):
        _require(group, _OF_GRID, 0, grid, "points")
        _require(group, _MAPS, 1, grid, "points")
    _require(series, _OF_IMAGE, 0, reference.shape, "pixels of the reference image")


def _require(group: Any, names: Iterable[str], axis: int, shape: tuple[int, ...], of: str) -> None:
    """Check the two axes from `axis` on of those datasets that the group has."""
    for name in names:
        if name in group and (found := group[name].shape[axis : axis + 2]) != shape:
            place = group[name].name.removeprefix("/")
            got, other = (" × ".join(map(str, each)) for each in (found, shape))
            raise Contradiction(f"a result file in which {place} has {got or 'no'} values for {other} {of}")
