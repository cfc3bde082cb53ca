"""What displacements say about a picture: that it was measured against itself, or is torn."""

import math
import warnings

import numpy as np

from dic.correlation.field import Field
from dic.typing import Float

_STILL_PX = 1e-4
_PART = 0.1
"""Noise leaves fewer points still than this share."""
_JUMP_MIN_PX = 0.1
_CLEAR = 8.0
"""A jump is at least this multiple of the usual deviation of the other rows."""
_ELSEWHERE = 0.3
"""Away from a tear, the rows deviate by at most this part of its jump. A neck or a band of slip is wider."""
_OF_USUAL = 0.5
"""Rows with fewer points than this part of the usual number are left out."""
_ACROSS = 0.8
"""A tear goes across at least this part of the columns."""


def remarks_on(field: Field) -> list[str]:
    """Return one sentence for each thing about a picture that makes its strain doubtful."""
    found = [field.repetition] if field.repetition else []
    still = _still_share(field)
    if still == 1.0:
        found.append("no point has moved at all: this is the reference's own picture, or a copy of it")
    elif still >= _PART:
        found.append(
            f"{100 * still:.0f} % of the points have not moved at all: a part of this picture is the "
            "reference's"
        )
    if (place := _tear(field)) is not None:
        y_px, jump_px = place
        found.append(
            f"all columns jump by {jump_px:.2g} px at y = {y_px:.0f} px: a picture torn between two frames, "
            "a crack or a narrow band from side to side"
        )
    return found


def _still_share(field: Field) -> float:
    """Return the share of the points that have moved by less than the noise of any camera."""
    moved = np.abs(np.stack([field.u_px, field.v_px])[:, field.converged]).max(axis=0, initial=0.0)
    return float(np.mean(moved < _STILL_PX)) if moved.size else 0.0


def _tear(field: Field) -> tuple[float, float] | None:
    """Return the row, px, and the size, px, of a jump of the displacement across the picture, or None.

    A camera or frame grabber that is read while it is written delivers the rows above a line from one frame,
    and those below from another.
    """
    over = math.ceil(field.settings.subset_px / field.settings.step_px) + 1
    if len(field.y_px) < 3 * over:
        return None
    mask = field.converged
    tears = []
    for values in (field.u_px, field.v_px):
        shown = np.where(mask, values, np.nan)
        jumps = shown[over:] - shown[:-over]
        found = _line_of(jumps, over)
        if found is not None:
            row, jump_px = found
            between = np.interp(row + over / 2, np.arange(len(field.y_px)), field.y_px)
            tears.append((float(between), jump_px))
    return max(tears, key=lambda tear: abs(tear[1]), default=None)


def _line_of(jumps: Float, over: int) -> tuple[float, float] | None:
    """Return the row with a jump that all columns share and no other part of the picture has, or None."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # rows without a value
        of_rows = np.nanmedian(jumps, axis=1)
    # At the edge of a specimen a few points of a row have found the background.
    counts = np.count_nonzero(np.isfinite(jumps), axis=1)
    known = counts > _OF_USUAL * np.median(counts[counts > 0]) if counts.any() else counts > 0
    if np.count_nonzero(known) < 2 * over:
        return None
    usual = float(np.median(of_rows[known]))
    away = np.where(known, np.abs(of_rows - usual), 0.0)
    row = int(np.argmax(away))
    jump_px = float(of_rows[row] - usual)
    # The jump shows in all windows that contain its line.
    others = away[known & (np.abs(np.arange(len(away)) - row) > over)]
    if len(others) < over or abs(jump_px) < max(_JUMP_MIN_PX, _CLEAR * 1.4826 * float(np.median(others))):
        return None
    if float(others.max()) > _ELSEWHERE * abs(jump_px):
        return None
    shares = (jumps[row] - usual) / jump_px
    shares = shares[np.isfinite(shares)]
    across = np.count_nonzero((shares > 0.5) & (shares < 1.5)) >= _ACROSS * max(1, len(shares))
    middle = float(np.flatnonzero(away > abs(jump_px) / 2).mean())
    # Points within a subset of the edge are wrong together if the edge of the specimen is in their subsets.
    first, last = np.flatnonzero(known)[[0, -1]]
    inside = first + over / 2 - 1 < middle < last - over / 2 + 1
    return (middle, jump_px) if across and inside else None
