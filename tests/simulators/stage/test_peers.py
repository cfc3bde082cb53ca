"""Clients of vendors and other authors drive the simulated stages, each in a separate process."""

import json
import os

import pytest

from drivers.clock import SystemClock
from simulators.stage.device import StageDevice
from simulators.stage.newport import NewportServer
from simulators.stage.zaber import ZaberServer
from tests.peers import INSTALL_S, RUN_S, interpreter, run
from tests.tcp_servers import newport_on_tcp, zaber_on_tcp

pytestmark = [
    pytest.mark.extended,
    pytest.mark.timeout(2 * INSTALL_S + RUN_S),  # an environment is made on first use
]

ZABER_MOTION = """
import json, sys
from zaber_motion import Library
from zaber_motion.ascii import Connection
from zaber_motion.exceptions import CommandFailedException, MovementFailedException

# no network: no device database, so that values are the device's own
Library.disable_device_db_store()
where = sys.argv[1]
if where.startswith("/"):
    connection = Connection.open_serial_port(where)
else:
    host, port = where.split(":")
    connection = Connection.open_tcp(host, int(port))
said = {}
with connection:
    connection.enable_alerts()
    device = connection.get_device(1)
    axis = device.get_axis(1)
    said["serial"] = device.settings.get("system.serial")
    said["flags before"] = sorted(axis.warnings.get_flags())
    axis.home()
    said["flags after"] = sorted(axis.warnings.get_flags())
    axis.move_absolute(64000)
    said["absolute"] = axis.get_position()
    axis.move_relative(-12800)
    said["relative"] = axis.get_position()
    axis.settings.set("limit.max", 128000)
    said["limit"] = axis.settings.get("limit.max")
    axis.move_max()
    said["at the limit"] = axis.get_position()
    axis.move_velocity(-209715)
    axis.stop()
    said["stopped"] = not axis.is_busy()
    try:
        axis.move_absolute(10**9)
    except CommandFailedException as error:
        said["beyond"] = error.details.response_data
    said["echo"] = device.generic_command("tools echo hello").data
    for name in ("driver.temperature", "limit.cycle.dist", "resolution"):
        axis.settings.get(name)
    axis.driver_disable()
    axis.driver_enable()
print(json.dumps(said))
"""

ZABER_SERIAL = """
import json, sys
from zaber.serial import AsciiCommand, AsciiDevice, AsciiSerial

port = AsciiSerial(sys.argv[1])
device = AsciiDevice(port, 1)
axis = device.axis(1)
said = {}
axis.home()
axis.move_abs(64000)
said["absolute"] = axis.get_position()
axis.move_rel(-12800)
said["relative"] = device.get_position()
axis.move_vel(1000)
axis.stop()
reply = device.send("1 get maxspeed")
said["reply"] = [reply.reply_flag, reply.device_status, reply.warning_flag]
said["beyond"] = axis.send("move abs 999999999").data
said["status"] = axis.get_status()
port.close()
print(json.dumps(said))
"""

PYMEASURE = """
import json, sys
from pymeasure.instruments.newport import ESP300

controller = ESP300(sys.argv[1], visa_library="@py", read_termination="\\r\\n", write_termination="\\r")
axis = controller.x
said = {}
controller.clear_errors()
said["off"] = axis.enabled
axis.position = 5
said["refused"] = [str(error) for error in controller.errors]
axis.enable()
axis.home()
axis.wait_for_stop()
axis.units = "degree"
said["units"] = axis.units
axis.left_limit, axis.right_limit = -5, 90
said["limits"] = [axis.left_limit, axis.right_limit]
axis.position = 12.5
axis.wait_for_stop()
said["position"] = axis.position
axis.position = 95
said["beyond"] = [str(error) for error in controller.errors]
axis.zero()
said["zero"] = axis.position
axis.disable()
said["off again"] = axis.enabled
print(json.dumps(said))
"""


@pytest.fixture
def device():
    # quick, for these clients live in real time
    return StageDevice(SystemClock(), power_up_angle_deg=1.0, speed_deg_s=200.0, acceleration_deg_s2=20_000.0)


@pytest.mark.parametrize("line", [ZaberServer, zaber_on_tcp], ids=["pty", "TCP"])
def test_the_vendors_client_drives_the_stage(device, line, serve):
    python = interpreter("zaber-motion", "zaber-motion==10.*")
    server = serve(line(device))
    address = server.address
    # the client takes the name for the port's own, which a link is not
    said = json.loads(run(python, "-c", ZABER_MOTION, os.path.realpath(address) if line is ZaberServer
                          else address))  # fmt: skip
    assert said == {
        "serial": 110001.0,
        "flags before": ["WR"],
        "flags after": [],
        "absolute": 64000.0,
        "relative": 51200.0,
        "limit": 128000.0,
        "at the limit": 128000.0,
        "stopped": True,
        "beyond": "BADDATA",
        "echo": "hello",
    }
    moves = [name for _, name in device.executed if name.startswith("move")]
    assert moves == ["move 64000", "move 51200", "move 128000"]


def test_the_vendors_older_client_drives_it_without_ids_and_checksums(device, serve):
    python = interpreter("zaber.serial", "zaber.serial==0.9.*")
    server = serve(ZaberServer(device))
    said = json.loads(run(python, "-c", ZABER_SERIAL, server.address))
    assert said == {
        "absolute": 64000,
        "relative": 51200,
        "reply": ["OK", "IDLE", "NI"],
        "beyond": "BADDATA",
        "status": "IDLE",
    }


@pytest.mark.parametrize("line", [NewportServer, newport_on_tcp], ids=["pty", "TCP"])
def test_pymeasure_drives_the_stage_on_an_esp301(device, line, serve):
    python = interpreter("pymeasure", "pymeasure==0.16.*", "pyvisa-py", "pyserial")
    server = serve(line(device, SystemClock()))
    host, _, port = server.address.rpartition(":")
    resource = f"TCPIP::{host}::{port}::SOCKET" if host else f"ASRL{server.address}::INSTR"
    said = json.loads(run(python, "-c", PYMEASURE, resource))
    assert said == {
        "off": False,
        "refused": ["Newport ESP300 axis 1 reported the error: MOTOR NOT ENABLED"],
        "units": "degree",
        "limits": [-5, 90],
        "position": 12.5,
        "beyond": ["Newport ESP300 axis 1 reported the error: POSITIVE SOFTWARE LIMIT DETECTED"],
        "zero": 0.0,
        "off again": False,
    }
    assert device.angle_deg() == pytest.approx(12.5)
