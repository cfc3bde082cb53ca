"""Every stage driver of this project passes the contract tests, on every line of the simulators."""

import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import pytest

from drivers.clock import VirtualClock
from drivers.interfaces import OpenContext, RotationStage
from drivers.stages.esp301.settings import EspSettings
from drivers.stages.esp301.stage import open_stage as open_esp301
from drivers.stages.zaber.settings import ZaberSettings
from drivers.stages.zaber.stage import open_stage as open_zaber
from drivers.testing import StageBench, StageContract
from simulators.stage.device import StageDevice
from simulators.stage.newport import NewportServer
from simulators.stage.zaber import ZaberServer
from simulators.wire.faults import STAGE, FaultPanel
from tests.tcp_servers import newport_on_tcp, zaber_on_tcp

SPEED_DEG_S = 4.0
LIMITS = {"angle_min_deg": -5.0, "angle_max_deg": 365.0, "speed_deg_s": SPEED_DEG_S}


def zaber(port: str, context: OpenContext) -> RotationStage:
    return open_zaber(ZaberSettings(port=port, reply_timeout_s=0.5, **LIMITS), context)


def newport(port: str, context: OpenContext) -> RotationStage:
    return open_esp301(EspSettings(port=port, reply_timeout_s=0.5, **LIMITS), context)


LINES: dict[str, tuple[Callable[[StageDevice, VirtualClock], Any], str, Callable[..., RotationStage]]] = {
    "zaber-pty": (lambda device, clock: ZaberServer(device), "{}", zaber),
    "zaber-tcp": (lambda device, clock: zaber_on_tcp(device), "socket://{}", zaber),
    "newport-pty": (NewportServer, "{}", newport),
    "newport-tcp": (newport_on_tcp, "socket://{}", newport),
}
MOTION = re.compile(rb"\b(home|move)\b|^\d(OR|PA(?!\?)|PR|MV)")


@dataclass(frozen=True)
class FaultyBench(StageBench):
    """A bench with the simulator's faults of the line."""

    panel: FaultPanel = field(default_factory=lambda: FaultPanel(STAGE))


@contextmanager
def bench_on(line: str) -> Iterator[FaultyBench]:
    serve, url, open_stage = LINES[line]
    clock = VirtualClock()
    device = StageDevice(clock, power_up_angle_deg=12.0)
    server = serve(device, clock)
    motions: list[bytes] = []
    respond = server.respond

    def watched(message: bytes) -> bytes:
        if MOTION.search(message):
            motions.append(message)
        return respond(message)

    server.respond = watched
    try:
        stage = open_stage(url.format(server.address), OpenContext("stage", clock))
        try:
            yield FaultyBench(
                stage,
                clock,
                LIMITS["angle_min_deg"],
                LIMITS["angle_max_deg"],
                speed_deg_s=SPEED_DEG_S,
                motions=lambda: len(motions),
                lose_answers=lambda: server.faults.switch_on("drop"),
                restore=server.faults.clear,
                power_cycle=device.power_cycle,
                panel=server.faults,
            )
        finally:
            stage.close()
    finally:
        server.close()


@pytest.mark.parametrize("line", LINES)
class TestStages(StageContract):
    @pytest.fixture
    def bench(self, line: str) -> Iterator[StageBench]:
        with bench_on(line) as bench:
            yield bench


def test_a_handle_that_a_bench_has_not_got_skips_the_test_and_says_so():
    with bench_on("zaber-pty") as bench:
        bare = StageBench(bench.stage, bench.clock, bench.angle_min_deg, bench.angle_max_deg)
        with pytest.raises(pytest.skip.Exception, match="cannot count motions"):
            StageContract().test_opening_moves_nothing(bare)
