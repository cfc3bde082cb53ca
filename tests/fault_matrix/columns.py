"""The columns of the fault matrix: each driver on each kind of line, with each register map."""

import importlib.util
from collections.abc import Callable
from dataclasses import dataclass

from drivers.stages.esp301.settings import EspSettings
from drivers.stages.esp301.stage import open_stage as open_esp301
from drivers.stages.zaber.settings import ZaberSettings
from drivers.stages.zaber.stage import open_stage as open_zaber
from simulators.closed_machine.modbus import AnalogueBoxRtuServer, AnalogueBoxServer
from simulators.interlock.module import InputModuleRtuServer, InputModuleServer
from simulators.load_frame.modbus import LoadFrameRtuServer, LoadFrameServer
from simulators.stage.newport import NewportServer
from simulators.stage.zaber import ZaberServer
from simulators.wire.faults import (
    CAMERA,
    CLOSED_MACHINE,
    DAQ,
    INSTRUMENT,
    INTERLOCK,
    LOAD_FRAME,
    MQTT,
    NEWPORT,
    STAGE,
)
from simulators.wire.ports import LOCALHOST
from tests.fault_matrix.bench import Bench
from tests.fault_matrix.camera_benches import (
    AravisBench,
    AravisStreamBench,
    GentlBench,
    GentlStreamBench,
    OpencvBench,
    SimulatedCameraBench,
    V4l2Bench,
    V4l2StreamBench,
)
from tests.fault_matrix.channel_benches import DaqBench, ModbusChannelsBench, ModbusPulseBench
from tests.fault_matrix.interlock_benches import ContactBench, RegisterBench
from tests.fault_matrix.line_benches import AravisLineBench, GentlLineBench
from tests.fault_matrix.machine_benches import LoadFrameBench, SpeedBench, StageBench
from tests.fault_matrix.text_benches import IDENTIFIED, AskedBench, MqttBench, SendingMeterBench
from tests.tcp_servers import interlocks_rtu_on_tcp, load_frame_rtu_on_tcp, zaber_on_tcp

SPEED = "change of speed"
"""The table of the changes of a load frame's speed in motion."""


@dataclass(frozen=True)
class Column:
    """One driver on one kind of line. `needs` are packages without which the column is not tried.

    `table` is the table of the document that has the column; by default that of its kind of device.
    """

    name: str
    device: str
    make: Callable[[], Bench]
    needs: tuple[str, ...] = ()
    table: str = ""

    @property
    def missing(self) -> list[str]:
        """The packages that are needed and not installed."""
        return [package for package in self.needs if importlib.util.find_spec(package) is None]


COLUMNS = [
    Column(
        "zaber-ascii, pty",
        STAGE,
        lambda: StageBench(lambda device, _: ZaberServer(device), ZaberSettings, open_zaber),
    ),
    Column(
        "zaber-ascii, TCP",
        STAGE,
        lambda: StageBench(lambda device, _: zaber_on_tcp(device), ZaberSettings, open_zaber, "socket://"),
    ),
    Column(
        "newport-esp301, pty",
        NEWPORT,
        lambda: StageBench(NewportServer, EspSettings, open_esp301),
    ),
    Column("modbus-frame, TCP, generic", LOAD_FRAME, lambda: LoadFrameBench(LoadFrameServer, "generic")),
    Column(
        "modbus-frame, RTU, scaled-integers",
        LOAD_FRAME,
        lambda: LoadFrameBench(LoadFrameRtuServer, "scaled-integers"),
    ),
    Column(
        "modbus-frame, RTU over TCP, separate-words",
        LOAD_FRAME,
        lambda: LoadFrameBench(load_frame_rtu_on_tcp, "separate-words", "rtu://"),
    ),
    Column(
        "change of speed, modbus-frame, TCP, generic",
        LOAD_FRAME,
        lambda: SpeedBench(LoadFrameServer, "generic"),
        table=SPEED,
    ),
    Column(
        "change of speed, modbus-frame, RTU, scaled-integers",
        LOAD_FRAME,
        lambda: SpeedBench(LoadFrameRtuServer, "scaled-integers"),
        table=SPEED,
    ),
    Column(
        "change of speed, modbus-frame, RTU over TCP, separate-words",
        LOAD_FRAME,
        lambda: SpeedBench(load_frame_rtu_on_tcp, "separate-words", "rtu://"),
        table=SPEED,
    ),
    Column("modbus-input, contact, TCP", INTERLOCK, lambda: ContactBench(InputModuleServer)),
    Column(
        "modbus-input, register, RTU", INTERLOCK, lambda: RegisterBench(InputModuleRtuServer, numbered=False)
    ),
    Column(
        "modbus-input, contact, RTU over TCP",
        INTERLOCK,
        lambda: ContactBench(interlocks_rtu_on_tcp, "rtu://", numbered=False),
    ),
    Column("text-channels, asked, identified, pty", INSTRUMENT, lambda: AskedBench("", None, IDENTIFIED)),
    Column("text-channels, asked, TCP", INSTRUMENT, lambda: AskedBench("socket://", LOCALHOST, {})),
    Column(
        "text-channels, asked, with a time, VISA on TCP",
        INSTRUMENT,
        lambda: AskedBench("visa://TCPIP0::", LOCALHOST, {}, tells_time=True),
        ("pyvisa", "pyvisa_py"),
    ),
    Column("text-channels, sending, pty", INSTRUMENT, SendingMeterBench),
    Column("mqtt-channels, with a time", MQTT, MqttBench, ("paho", "amqtt")),
    Column("modbus-channels, TCP", CLOSED_MACHINE, lambda: ModbusChannelsBench(AnalogueBoxServer)),
    Column(
        "modbus-channels, RTU",
        CLOSED_MACHINE,
        lambda: ModbusChannelsBench(AnalogueBoxRtuServer, numbered=False),
    ),
    Column("modbus-pulse, coil, TCP", CLOSED_MACHINE, lambda: ModbusPulseBench(AnalogueBoxServer)),
    Column(
        "modbus-pulse, register, RTU",
        CLOSED_MACHINE,
        lambda: ModbusPulseBench(AnalogueBoxRtuServer, table="holding", output=1001),
    ),
    Column("nidaqmx-channels, imitated library", DAQ, DaqBench),
    Column("simulated-camera", CAMERA, SimulatedCameraBench),
    Column("v4l2, image", CAMERA, V4l2Bench),
    Column("v4l2, stream", CAMERA, V4l2StreamBench),
    Column("aravis, image", CAMERA, AravisBench),
    Column("aravis, stream", CAMERA, AravisStreamBench),
    Column("aravis, line", CAMERA, AravisLineBench),
    Column("gentl, image", CAMERA, GentlBench),
    Column("gentl, stream", CAMERA, GentlStreamBench),
    Column("gentl, line", CAMERA, GentlLineBench),
    Column("opencv-camera, image", CAMERA, OpencvBench),
]
