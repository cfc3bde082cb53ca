"""Fixtures with a rig of simple simulated devices on a virtual clock; faults are set by the tests."""

import tomllib
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import ExitStack, closing
from dataclasses import dataclass, field, replace
from pathlib import Path

import h5py
import numpy as np
import pytest

from drivers.clock import Clock, SystemClock, VirtualClock
from drivers.interfaces import (
    CameraInfo,
    DeviceInfo,
    Frame,
    InterlockState,
    LoadFrameLimits,
    LoadFrameState,
    OperatorAction,
    OperatorQuestion,
    StageState,
)
from drivers.signals import ChannelDevice
from rig.devices import OpenedInterlock, OpenedTrigger, Rig
from rig.engine.engine import Engine
from rig.limit_settings import RigLimits
from rig.protocol.protocol import Protocol
from rig.protocol.rotation import RotationProtocol
from rig.protocol.tension import TensionProtocol
from rig.recorder import Recorder, RunHeader, StepRecord
from rig.recorder.header import channel_records, interlock_records
from rig.rigfile import CALL_TIMEOUT_S
from tests.command_line import Program
from tests.places import example

# Grips that seat (soft up to 0.5 kN), 17.8 kN/mm elastic, 1 kN/mm once it yields at 8.5 kN.
DISPLACEMENTS_MM = np.array([-10.0, 0.0, 0.1, 0.55, 10.05])
LOADS_N = np.array([0.0, 0.0, 500.0, 8500.0, 18000.0])

FRAME = DeviceInfo("fakes", "frame", "1", simulated=True)
FRAME_LIMITS = LoadFrameLimits(-100.0, 15000.0, -1.0, 6.0, 0.1, 1000.0)
STAGE = DeviceInfo("fakes", "stage", "2", simulated=True)
INTERLOCK = DeviceInfo("fakes", "interlock", "", simulated=True)
CAMERA = CameraInfo("fakes", "camera", "3", simulated=True, width_px=8, height_px=6, bits=8)


@dataclass
class FakeLoadFrame:
    clock: Clock
    calls: list[str]
    zero_n: float = 0.0
    displacement_mm: float = 0.0
    load_scale: float = 1.0
    stuck: bool = False
    on_read: Callable[[int, LoadFrameState], LoadFrameState] = lambda count, state: state
    on_hold: Callable[[], None] = lambda: None
    reads: int = 0
    info: DeviceInfo = FRAME
    limits: LoadFrameLimits = FRAME_LIMITS
    _path: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)

    def _advance(self) -> bool:
        start_s, start_mm, target_mm, speed_mm_s = self._path
        travel_mm = speed_mm_s * (self.clock.now_s() - start_s)
        if self.stuck or travel_mm <= 0.0:
            return travel_mm > 0.0
        moving = travel_mm < abs(target_mm - start_mm)
        self.displacement_mm = start_mm + np.sign(target_mm - start_mm) * travel_mm if moving else target_mm
        return bool(moving)

    def read(self) -> LoadFrameState:
        self.reads += 1
        moving = self._advance()
        load_n = (
            float(np.interp(self.displacement_mm, DISPLACEMENTS_MM, LOADS_N)) * self.load_scale + self.zero_n
        )
        state = LoadFrameState(
            load_n, self.displacement_mm, moving, not moving, not moving, self.reads, (), self.clock.now_s()
        )
        return self.on_read(self.reads, state)

    def go_to_load(self, load_n: float, rate_n_s: float) -> None:
        self.calls.append(f"load {load_n:g}")
        target_mm = float(np.interp(load_n, LOADS_N[1:], DISPLACEMENTS_MM[1:]))
        duration_s = abs(load_n - self.read().load_n) / rate_n_s
        self._go(target_mm, abs(target_mm - self.displacement_mm) / max(duration_s, 0.01))

    def go_to_displacement(self, displacement_mm: float, speed_mm_s: float) -> None:
        self.calls.append(f"displacement {displacement_mm:.6f}")
        self._go(displacement_mm, speed_mm_s)

    def _go(self, target_mm: float, speed_mm_s: float) -> None:
        self._advance()
        self._path = (self.clock.now_s(), self.displacement_mm, target_mm, speed_mm_s)

    def hold(self) -> None:
        self.calls.append("hold")
        self._advance()
        self._path = (0.0, 0.0, 0.0, 0.0)
        self.on_hold()

    def tare(self) -> None:
        self.calls.append("tare")
        self.zero_n = 0.0
        self.displacement_mm = 0.0

    def close(self) -> None:
        self.calls.append("close load frame")


@dataclass
class FakeStage:
    clock: Clock
    calls: list[str]
    homed: bool = False
    angle_deg: float = 77.0
    speed_deg_s: float = 10.0
    on_read: Callable[[StageState], StageState] = lambda state: state
    info: DeviceInfo = STAGE
    _target: tuple[float, float] = (0.0, 77.0)

    def read(self) -> StageState:
        arrival_s, target_deg = self._target
        moving = self.clock.now_s() < arrival_s
        if not moving:
            self.angle_deg = target_deg
        return self.on_read(StageState(self.angle_deg, moving, self.homed, (), self.clock.now_s()))

    def home(self) -> None:
        self.calls.append("home")
        self.homed = True
        self._target = (self.clock.now_s() + 5.0, 3.0)

    def move_to(self, angle_deg: float) -> None:
        self.calls.append(f"angle {angle_deg:g}")
        travel_s = abs(angle_deg - self.angle_deg) / self.speed_deg_s
        self._target = (self.clock.now_s() + travel_s, angle_deg)

    def stop(self) -> None:
        self.calls.append("stop")

    def close(self) -> None:
        self.calls.append("close stage")


@dataclass
class FakeCamera:
    clock: Clock
    on_grab: Callable[[int, Frame], Frame] = lambda count, frame: frame
    grabs: int = 0
    info: CameraInfo = CAMERA

    def grab(self, timeout_s: float) -> Frame:
        self.grabs += 1
        exposed_s, utc = self.clock.now_s(), self.clock.utc()
        self.clock.sleep(0.02)
        image = np.full((6, 8), self.grabs, np.uint8)
        frame = Frame(image, exposed_s, self.clock.now_s(), utc, self.grabs, 0, 1000.0, 1.0)
        return self.on_grab(self.grabs, frame)

    def close(self) -> None:
        pass


@dataclass
class FakeInterlock:
    clock: Clock
    value_of: Callable[[int], float]
    reads: int = 0
    info: DeviceInfo = INTERLOCK
    unit: str = "°C"

    def read(self) -> InterlockState:
        self.reads += 1
        return InterlockState(self.value_of(self.reads), self.clock.now_s())

    def close(self) -> None:
        pass


@dataclass
class FakeOperator:
    calls: list[str]
    on_perform: Callable[[OperatorAction], None] = lambda action: None
    on_ask: Callable[[OperatorQuestion], None] = lambda question: None
    on_withdraw: Callable[[], None] = lambda: None

    def perform(self, action: OperatorAction) -> None:
        self.calls.append(action.name)
        self.on_perform(action)

    def ask(self, question: OperatorQuestion) -> None:
        self.calls.append(f"ask {question.word}")
        self.on_ask(question)

    def withdraw(self) -> None:
        self.calls.append("withdraw")
        self.on_withdraw()


@dataclass
class FakeRig:
    """A protocol, simple simulated devices, and records of their calls and of the engine's states."""

    protocol: Protocol
    path: Path
    calls: list[str] = field(default_factory=list)
    states: list[str] = field(default_factory=list)
    definition: str = ""
    clock: Clock = field(default_factory=VirtualClock)
    interlocks: dict[str, OpenedInterlock] = field(default_factory=dict)
    channels: dict[str, ChannelDevice] = field(default_factory=dict)
    measured: dict[str, str] = field(default_factory=dict)
    triggers: dict[str, OpenedTrigger] = field(default_factory=dict)
    limits: RigLimits = field(default_factory=RigLimits)
    configuration: str = ""
    call_timeout_s: float = CALL_TIMEOUT_S
    leaving_s: float = 60.0
    """Real time in s for listeners to handle the last reports; long enough for a busy computer."""

    def __post_init__(self) -> None:
        self.cameras = {"on_axis": FakeCamera(self.clock), "off_axis": FakeCamera(self.clock)}
        self.operator = FakeOperator(self.calls)
        devices = self.protocol.conditions.devices
        self.load_frame = FakeLoadFrame(self.clock, self.calls) if "load_frame" in devices else None
        self.stage = FakeStage(self.clock, self.calls) if "stage" in devices else None

    def engine(self, *, on_status=(), on_step=(), reopen=None, live=None, **options) -> Engine:
        rig = Rig(
            self.clock,
            self.operator,
            self.cameras,
            self.stage,
            self.load_frame,
            virtual=True,
            limits=self.limits,
            interlocks=self.interlocks,
            channels=self.channels,
            measured=self.measured,
            triggers=self.triggers,
            call_timeout_s=self.call_timeout_s,
            reopen=reopen or {},
        )
        header = RunHeader(
            title=self.protocol.title,
            run_id="test",
            definition=self.definition,
            configuration=self.configuration,
            start=self.clock.utc(),
            versions="",
            sample=self.protocol.sample,
            grid=self.protocol.grid,
            simulated=True,
        )
        recorder = Recorder(
            self.path,
            header,
            {name: camera.info for name, camera in self.cameras.items()},
            stage=self.stage.info if self.stage else None,
            load_frame=self.load_frame.info if self.load_frame else None,
            interlocks=interlock_records(rig),
            channels=channel_records(rig),
        )
        engine = Engine(
            self.protocol, rig, recorder, on_status=[self._note, *on_status], on_step=on_step, **options
        )
        engine.leaving_s = self.leaving_s
        if live is not None:
            engine.measure_gauges_with(live)
        return engine

    def events(self) -> list[str]:
        """Return the messages of all events in the run file."""
        with h5py.File(self.path) as file:
            return [message.decode() for message in file["entry/events/message"][()]]

    def _note(self, status) -> None:
        if not self.states or self.states[-1] != status.state.name:
            self.states.append(status.state.name)


def in_real_time(rotation_table: dict, path: Path) -> FakeRig:
    """Return a quick rotation rig in real time, with a call deadline longer than the limit of a test."""
    protocol = RotationProtocol.model_validate(rotation_table)
    rig = FakeRig(protocol, path, clock=SystemClock(), call_timeout_s=100.0)
    rig.stage.homed, rig.stage.speed_deg_s = True, 1e4
    return rig


@pytest.fixture
def tension_table() -> dict:
    return tomllib.loads(example("tension", ("poll_s = 0.2", "poll_s = 1.0")))


@pytest.fixture
def rotation_table() -> dict:
    return tomllib.loads(example("rotation"))


@pytest.fixture
def tension(tension_table: dict, tmp_path: Path) -> FakeRig:
    return FakeRig(TensionProtocol.model_validate(tension_table), tmp_path / "run.h5")


@pytest.fixture
def rotation(rotation_table: dict, tmp_path: Path) -> FakeRig:
    return FakeRig(RotationProtocol.model_validate(rotation_table), tmp_path / "run.h5")


@pytest.fixture
def on_frame_state() -> Callable:
    """A function that changes values of a load frame's state from the reading number `first` on."""

    def script(first: int, **changes) -> Callable[[int, LoadFrameState], LoadFrameState]:
        return lambda count, state: replace(state, **changes) if count >= first else state

    return script


@pytest.fixture
def at_step(monkeypatch) -> Callable[[int | None, Callable[[], None]], None]:
    """A function `at_step(index, act)`: `act` is called after the engine has given a step to the recorder.

    The engine's own thread calls `act`. A listener would be called later, at an unknown state of the run.
    """
    record_step = Recorder.step

    def arrange(index: int | None, act: Callable[[], None]) -> None:
        def step(recorder: Recorder, record: StepRecord) -> Future[None]:
            written = record_step(recorder, record)
            if record.step.index == index:
                act()
            return written

        monkeypatch.setattr(Recorder, "step", step)

    return arrange


@pytest.fixture
def start() -> Iterator[Callable[..., Program]]:
    """A function `start(*arguments)` that starts `rig` as a program; the program ends with the test."""
    with ExitStack() as programs:
        yield lambda *arguments, **how: programs.enter_context(closing(Program(*arguments, **how)))
