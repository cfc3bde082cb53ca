from .load_frame.device import LoadFrameDevice as LoadFrameDevice
from .load_frame.layout import (
    LAYOUTS as LAYOUTS,
    RegisterLayout as RegisterLayout,
)
from .load_frame.modbus import (
    LoadFrameRtuServer as LoadFrameRtuServer,
    LoadFrameServer as LoadFrameServer,
)
from .rig.camera import (
    FreeRunningCamera as FreeRunningCamera,
    SimulatedCamera as SimulatedCamera,
)
from .rig.camera_settings import CameraSettings as CameraSettings
from .rig.simulation import Simulation as Simulation
from .rig.virtual_rig import (
    VirtualRig as VirtualRig,
    VirtualRigSettings as VirtualRigSettings,
)
from .scene.exact_properties import exact_properties as exact_properties
from .scene.optics import PinholeCamera as PinholeCamera
from .scene.scene import (
    Misalignment as Misalignment,
    Scene as Scene,
    Surface as Surface,
)
from .scene.specimen import (
    SimulatedSpecimen as SimulatedSpecimen,
    SpecimenSettings as SpecimenSettings,
    SpecimenState as SpecimenState,
)
from .stage.device import StageDevice as StageDevice
from .stage.newport import NewportServer as NewportServer
from .stage.zaber import ZaberServer as ZaberServer
from .wire.faults import (
    FAULTS as FAULTS,
    Fault as Fault,
    FaultPanel as FaultPanel,
)
from .wire.rig_faults import RigFaults as RigFaults
