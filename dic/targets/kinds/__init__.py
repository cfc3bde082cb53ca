"""The kinds of calibration targets, one module for each.

A new kind is a module with a subclass of `Target`, and its class in `_KINDS`. The printed sheets, the run
files and the options of the commands take the kinds from `TARGETS`.
"""

from collections.abc import Mapping
from typing import Any, Union

from dic.errors import require_kind
from dic.targets.kinds.asymmetric_dots import AsymmetricDotTarget
from dic.targets.kinds.charuco import CharucoTarget
from dic.targets.kinds.checkerboard import CheckerboardTarget
from dic.targets.kinds.dots import DotTarget
from dic.targets.kinds.line_grid import LineGridTarget
from dic.targets.kinds.target import Target

__all__ = [
    "TARGETS", "AsymmetricDotTarget", "CharucoTarget", "CheckerboardTarget", "DotTarget", "LineGridTarget",
    "Target", "require_target",
]  # fmt: skip

_KINDS: tuple[type[Target], ...] = (
    LineGridTarget,
    CheckerboardTarget,
    CharucoTarget,
    DotTarget,
    AsymmetricDotTarget,
)

TARGETS: Mapping[str, type[Target]] = {kind.name: kind for kind in _KINDS}
"""The class of each kind of target, by its name in protocols, run files and commands."""


def require_target(target: Target, source: str, remedy: str) -> None:
    """Raise a MeasurementError if an argument is no target, or a target that cannot be."""
    known: Any = Union[_KINDS]  # noqa: UP007  # the message names each kind
    require_kind("target", target, known, remedy)
    target.require_possible(source)
