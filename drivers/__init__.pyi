from .clock import (
    Clock as Clock,
    Event as Event,
    SystemClock as SystemClock,
    VirtualClock as VirtualClock,
)
from .errors import (
    ConfigurationError as ConfigurationError,
    DeviceError as DeviceError,
    DeviceFault as DeviceFault,
    DeviceTimeout as DeviceTimeout,
    LinkLost as LinkLost,
)
from .interfaces import (
    Camera as Camera,
    CameraInfo as CameraInfo,
    ChangesSpeed as ChangesSpeed,
    DeviceInfo as DeviceInfo,
    Frame as Frame,
    Interlock as Interlock,
    InterlockState as InterlockState,
    LoadFrame as LoadFrame,
    LoadFrameLimits as LoadFrameLimits,
    LoadFrameState as LoadFrameState,
    OpenContext as OpenContext,
    Operator as Operator,
    OperatorAction as OperatorAction,
    ReadsSettings as ReadsSettings,
    RotationStage as RotationStage,
    Setting as Setting,
    StageState as StageState,
)
from .registry import (
    DeviceKind as DeviceKind,
    DriverSpec as DriverSpec,
    Finder as Finder,
    Found as Found,
    Guard as Guard,
    GuardSpec as GuardSpec,
    SerialPort as SerialPort,
    driver_names as driver_names,
    find_driver as find_driver,
)
from .settings import Settings as Settings
from .signals import (
    ChannelDevice as ChannelDevice,
    Samples as Samples,
    Signal as Signal,
    TriggerOutput as TriggerOutput,
)
