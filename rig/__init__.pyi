from .commands.repair import (
    Repair as Repair,
    repair_run as repair_run,
)
from .commands.verify import (
    CameraCheck as CameraCheck,
    InterlockCheck as InterlockCheck,
    Verification as Verification,
    verify_run as verify_run,
)
from .devices import (
    Rig as Rig,
    open_rig as open_rig,
)
from .engine.engine import Engine as Engine
from .engine.signals import aborting_on_signals as aborting_on_signals
from .engine.status import (
    AtRest as AtRest,
    EngineStatus as EngineStatus,
    Outcome as Outcome,
    State as State,
)
from .errors import (
    Aborted as Aborted,
    BadImage as BadImage,
    LimitViolation as LimitViolation,
    ProtocolError as ProtocolError,
    RecordingError as RecordingError,
    RigError as RigError,
    SettleTimeout as SettleTimeout,
    SpecimenBroken as SpecimenBroken,
)
from .facts import (
    RigFacts as RigFacts,
    facts_of_file as facts_of_file,
)
from .news.run_news import NewsOptions as NewsOptions
from .plan import (
    Plan as Plan,
    PlannedStep as PlannedStep,
    make_plan as make_plan,
)
from .protocol.phased import PhasesProtocol as PhasesProtocol
from .protocol.protocol import (
    Protocol as Protocol,
    read_protocol as read_protocol,
)
from .protocol.rotation import RotationProtocol as RotationProtocol
from .protocol.step import (
    ProtocolStep as ProtocolStep,
    RigReading as RigReading,
)
from .protocol.tension import TensionProtocol as TensionProtocol
from .recorder import (
    InterlockRecord as InterlockRecord,
    Recorder as Recorder,
    RunHeader as RunHeader,
    StepRecord as StepRecord,
)
from .replay.replay import (
    Replay as Replay,
    replay_run as replay_run,
)
from .rigfile import (
    DeviceEntry as DeviceEntry,
    RigFile as RigFile,
    read_rig as read_rig,
)
from .run import (
    plan_protocol as plan_protocol,
    run_protocol as run_protocol,
)
from .run_file import (
    RunFile as RunFile,
    RunFileError as RunFileError,
    RunInfo as RunInfo,
    RunInterlock as RunInterlock,
    RunStep as RunStep,
)
