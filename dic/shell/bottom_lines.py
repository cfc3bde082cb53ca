"""Lines at the bottom of a terminal that change while a command works. Other lines are printed above them."""

import os
import stat
import sys
from collections.abc import Callable
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.console import RenderableType
    from rich.live import Live

_DUMB = ("dumb", "unknown")
"""Types of terminals (the variable TERM) that cannot move the cursor."""


def bottom_lines(draw: "Callable[[], RenderableType]", refreshes_per_s: float) -> "Live | None":
    """Return a display of the library Rich that shows the lines of `draw`, or None if nothing may be drawn.

    Nothing may be drawn if standard error is not a terminal, or is a terminal that cannot move its cursor.
    Nothing may be drawn if standard output is a pipe, because the reader of the pipe, such as `tee`, may
    print on the same terminal, between the drawn lines.

    `draw`: returns the present lines at the bottom of the terminal.
    """
    if not sys.stderr.isatty() or os.environ.get("TERM", "").lower() in _DUMB or _leads_to_a_reader():
        return None
    from rich.console import Console
    from rich.live import Live

    return Live(
        # With soft wrapping, the terminal breaks a long line. Rich would break the line with line feeds, and
        # these would stay in a copied path or sentence.
        console=Console(stderr=True, soft_wrap=True),
        refresh_per_second=refreshes_per_s,
        transient=True,
        # On a terminal, Rich prints other lines above the drawn lines. Lines for a file stay unchanged.
        redirect_stdout=sys.stdout.isatty(),
        get_renderable=draw,
    )


def _leads_to_a_reader() -> bool:
    """Return True if another program reads the standard output."""
    try:
        mode = os.fstat(sys.stdout.fileno()).st_mode
    except (OSError, ValueError):
        # A stream without a descriptor keeps its lines in memory, so no other program reads them.
        return False
    return stat.S_ISFIFO(mode) or stat.S_ISSOCK(mode)
