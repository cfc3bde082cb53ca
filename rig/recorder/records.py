"""Records for the run file: the data about a run, and its finished steps."""

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from datetime import datetime

from drivers.interfaces import DeviceInfo
from drivers.signals import Signal
from rig.mounting import Mounting
from rig.protocol.grid import AnyGrid
from rig.protocol.step import ProtocolStep, RigReading
from rig.protocol.tables import Sample

OPERATOR_DONE = "operator: done"
STEP_ON_FILE = "the step is on file"
COMPLETED = "protocol completed"
"""Messages of events that end a wait during which the devices were read.

A replay ends its waits at the same events.
"""

STEP_REACHED = "reached without images: step"
STEP_MISSED = "missed: step"
PHASE_ENDED = "the event of the phase has happened in step"
"""Each of these texts begins the message of an event about a step. The number of the step follows. A run that
is continued needs these events, because the table of steps does not contain steps without images."""

PAUSED = "paused in step"
GOES_ON = "goes on"
"""The messages of the events at the beginning and at the end of a pause begin with these texts. The number of
the step and the place in it follow the first one. A replay pauses at the same readings."""


@dataclass(frozen=True)
class RunHeader:
    """Data about a run that are known before the run begins.

    Attributes
    ----------
    definition, configuration : str
        The text of the protocol file and the text of the rig file.
    provenance : str
        The command line, the folder, the computer and the process of the program, as JSON.
    devices : mapping of str to str
        The settings of each device in the run file, as JSON. A key is a camera's name, ``stage``,
        ``load_frame``, or such as ``interlocks.door`` for the interlock named door.
    continues : str
        The earlier run that this run continues, as JSON. The text is empty if there is no earlier run.
    mounting : Mounting
        The declared mounting of grid and specimen.
    """

    title: str
    run_id: str
    definition: str
    configuration: str
    start: datetime
    versions: str
    sample: Sample
    grid: AnyGrid
    simulated: bool
    provenance: str = "{}"
    devices: Mapping[str, str] = field(default_factory=dict)
    continues: str = ""
    mounting: Mounting = field(default_factory=Mounting)


@dataclass(frozen=True)
class InterlockRecord(DeviceInfo):
    """An interlock of a run, with its identity and the range of its value in which the run continues.

    A missing bound is -inf or inf.
    """

    unit: str = ""
    allowed_min: float = -math.inf
    allowed_max: float = math.inf


NO_INTERLOCKS: Mapping[str, InterlockRecord] = {}


@dataclass(frozen=True)
class SignalRecord:
    """A signal of a run, as the run file describes it: the signal, and what the rig file takes it for.

    `quantity` is "load" or "displacement" for the signal of a load frame that is only read.
    """

    signal: Signal
    quantity: str = ""


@dataclass(frozen=True)
class ChannelsRecord:
    """A channel device of a run, with its signals in the order of its samples."""

    info: DeviceInfo
    signals: tuple[SignalRecord, ...]

    @property
    def names(self) -> list[str]:
        """The names of the signals."""
        return [each.signal.name for each in self.signals]

    def as_json(self) -> str:
        """Return what the run file says about the signals."""
        return json.dumps(
            {
                each.signal.name: {key: value for key, value in asdict(each.signal).items() if key != "name"}
                | {"quantity": each.quantity}
                for each in self.signals
            },
            ensure_ascii=False,
        )


NO_CHANNELS: Mapping[str, ChannelsRecord] = {}


@dataclass(frozen=True)
class StepRecord:
    """A finished step, its settled reading and its images.

    `frames` gives for each camera the row of the step's first image in the run file and the number of images.
    `due_s` is the time on the rig's clock at which the images were due, NaN if no clock asked for them.
    """

    step: ProtocolStep
    reading: RigReading
    frames: Mapping[str, tuple[int, int]]
    due_s: float = math.nan
