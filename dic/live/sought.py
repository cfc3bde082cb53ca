"""Points that are lost, and where a search of the whole frame has found them."""

from typing import NamedTuple

from dic.typing import Float, Indices


class LostPlaces(NamedTuple):
    """Points without a displacement, in the grid of the offline measurement."""

    rows: Indices
    columns: Indices
    """Shape (n,). Row and column of each point."""


class Sought(NamedTuple):
    """Points that a search has found in a frame."""

    rows: Indices
    columns: Indices
    """Shape (n,). Row and column of each point in the grid of the offline measurement."""
    warps: Float
    """Shape (n, 6 or 12). Their warps in the frame."""
    start: str
    """Name of the first guess that was right, such as "search" or "features"; "" if nothing was found."""
