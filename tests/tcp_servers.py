"""The simulated devices that are usually on a serial line, on TCP at any free port of this machine."""

from functools import partial

from simulators.interlock.module import InputModuleRtuServer
from simulators.load_frame.modbus import LoadFrameRtuServer
from simulators.stage.newport import NewportServer
from simulators.stage.zaber import ZaberServer
from simulators.wire.ports import LOCALHOST

zaber_on_tcp = partial(ZaberServer, host=LOCALHOST)
newport_on_tcp = partial(NewportServer, host=LOCALHOST)
load_frame_rtu_on_tcp = partial(LoadFrameRtuServer, host=LOCALHOST)
interlocks_rtu_on_tcp = partial(InputModuleRtuServer, host=LOCALHOST)
