"""One simulated rig for all tests of a module, because starting it takes longer than most of the tests."""

from collections.abc import Callable, Iterator
from contextlib import ExitStack

import pytest

from tests.rig.guardian.stopping import Bench, bench


@pytest.fixture(scope="module")
def bench_on(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Callable[..., Bench]]:
    """`bench_on(stage, load_frame)` returns the bench on these lines; only the latest one is open.

    Two benches at a time would disturb the times, because a simulation logs every 2 ms.
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
