"""The columns of the fault matrix: every driver, on each kind of line and with each register map."""

from collections.abc import Callable
from dataclasses import dataclass

from simulators.wire.faults import CAMERA, LOAD_FRAME, NEWPORT, STAGE
from tests.fault_matrix.bench import Bench
from tests.fault_matrix.camera_benches import (
    AravisBench,
    AravisStreamBench,
    OpencvBench,
    SimulatedCameraBench,
    V4l2Bench,
    V4l2StreamBench,
)
from tests.fault_matrix.machine_benches import LoadFrameBench, StageBench


@dataclass(frozen=True)
class Column:
    """One driver on one line."""

    name: str
    device: str
    make: Callable[[], Bench]


COLUMNS = [
    Column(
        "zaber-ascii, pty",
        STAGE,
        lambda: StageBench(
            "simulators.stage.zaber:StageServer", "drivers.stages.zaber.stage", "ZaberSettings"
        ),
    ),
    Column(
        "zaber-ascii, TCP",
        STAGE,
        lambda: StageBench(
            "simulators.stage.zaber:StageTcpServer",
            "drivers.stages.zaber.stage",
            "ZaberSettings",
            "socket://",
        ),
    ),
    Column(
        "newport-esp301, pty",
        NEWPORT,
        lambda: StageBench(
            "simulators.stage.newport:NewportServer", "drivers.stages.esp301.stage", "EspSettings"
        ),
    ),
    Column("modbus-frame, TCP, generic", LOAD_FRAME, lambda: LoadFrameBench("LoadFrameServer", "generic")),
    Column(
        "modbus-frame, RTU, scaled-integers",
        LOAD_FRAME,
        lambda: LoadFrameBench("LoadFrameRtuServer", "scaled-integers"),
    ),
    Column(
        "modbus-frame, RTU over TCP, separate-words",
        LOAD_FRAME,
        lambda: LoadFrameBench("LoadFrameRtuTcpServer", "separate-words", "rtu://"),
    ),
    Column("simulated-camera", CAMERA, SimulatedCameraBench),
    Column("v4l2, image", CAMERA, V4l2Bench),
    Column("v4l2, stream", CAMERA, V4l2StreamBench),
    Column("aravis, image", CAMERA, AravisBench),
    Column("aravis, stream", CAMERA, AravisStreamBench),
    Column("opencv-camera, image", CAMERA, OpencvBench),
]
