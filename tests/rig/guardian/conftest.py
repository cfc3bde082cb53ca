"""One simulated rig for all tests of a module, because starting it takes longer than most of the tests."""

from collections.abc import Callable, Iterator
from contextlib import ExitStack

import pytest

from tests.rig.guardian.stopping import Bench, bench


@pytest.fixture(scope="module")
def bench_on(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Callable[..., Bench]]:
    """A function `bench_on(stage, load_frame)` that returns the bench on these lines, and closes others.

    Two benches at the same time would disturb the measured times, because a simulation writes its log every 2
    ms.
    """
    with ExitStack() as opened:
        latest: dict[tuple[str, str], Bench] = {}

        def of(stage: str = "stage", load_frame: str = "load_frame") -> Bench:
            if (stage, load_frame) not in latest:
                opened.close()
                latest.clear()
                folder = tmp_path_factory.mktemp("bench")
                latest[stage, load_frame] = opened.enter_context(bench(folder, stage, load_frame))
            return latest[stage, load_frame]

        yield of
