"""Record the virtual rigs that the tested code opens from a rig file, so that a test can change them."""

from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from simulators.rig.virtual_rig import VirtualRig


@contextmanager
def opened_rigs() -> Iterator[list[VirtualRig]]:
    """Yield a list of the virtual rigs that are opened within the `with` block."""
    opened: list[VirtualRig] = []
    build = VirtualRig.__init__

    def built(rig: VirtualRig, *args, **kwargs) -> None:
        build(rig, *args, **kwargs)
        opened.append(rig)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(VirtualRig, "__init__", built)
        yield opened
