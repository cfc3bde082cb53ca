"""The virtual rigs that the code under test opens from a rig file, so that a test can act on them."""

from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from simulators.rig.virtual_rig import VirtualRig


@contextmanager
def opened_rigs() -> Iterator[list[VirtualRig]]:
    """The virtual rigs that are opened within this context."""
    opened: list[VirtualRig] = []
    build = VirtualRig.__init__

    def built(rig: VirtualRig, *args, **kwargs) -> None:
        build(rig, *args, **kwargs)
        opened.append(rig)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(VirtualRig, "__init__", built)
        yield opened
