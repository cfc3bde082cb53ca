"""A simulated Newport ESP301. A test can read and change the messages on its line."""

from drivers.clock import VirtualClock
from drivers.stages.esp301.settings import EspSettings
from drivers.stages.esp301.stage import open_stage
from simulators.stage.device import StageDevice
from simulators.stage.newport import NewportServer
from tests.drivers.stages.stage_kit import StageKit, Tamper, untampered
from tests.tcp_servers import newport_on_tcp


class EspLine(NewportServer):
    """A simulated controller on a pseudo-terminal. A test can read, change or lose each message."""

    def __init__(self, device: StageDevice, clock: VirtualClock) -> None:
        self.received: list[str] = []
        self.tamper: Tamper = untampered
        super().__init__(device, clock)

    def respond(self, message: bytes) -> bytes:
        self.received.append(message.decode())
        return self.tamper(message.decode(), lambda: super(EspLine, self).respond(message))

    def motions(self) -> list[str]:
        return [
            command
            for command in self.received
            if command[1:3] in ("OR", "PA", "PR", "MV") and not command.endswith("?")
        ]


def settings(port: str, **changes: object) -> EspSettings:
    values = {"port": port, "angle_min_deg": -5.0, "angle_max_deg": 365.0, "reply_timeout_s": 0.5}
    return EspSettings.model_validate(values | changes)


ESP301 = StageKit(open_stage, settings, EspLine, newport_on_tcp)
