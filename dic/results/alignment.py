"""Writes and reads the alignment of a specimen on a rotation stage in a result file."""

from typing import Any

from dic.out_of_plane.alignment import Alignment

_UNITS = {"slopes": "1", "covariance": "1", "pivot_mm": "mm"}


def write_alignment(group: Any, alignment: Alignment) -> None:
    """Write an alignment into a new group `alignment` of the open file."""
    for key, units in _UNITS.items():
        dataset = group.create_dataset(f"alignment/{key}", data=getattr(alignment, key))
        dataset.attrs["units"] = units


def read_alignment(group: Any) -> Alignment | None:
    """Return the alignment that `write_alignment` wrote; None if there is none."""
    if "alignment" not in group:
        return None
    return Alignment(**{key: group["alignment"][key][:] for key in _UNITS})
