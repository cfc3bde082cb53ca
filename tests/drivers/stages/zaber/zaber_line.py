"""A simulated Zaber stage. A test can read and change the messages on its line."""

from drivers.stages.zaber.protocol import lrc
from drivers.stages.zaber.settings import ZaberSettings
from drivers.stages.zaber.stage import open_stage
from simulators.stage.device import StageDevice
from simulators.stage.zaber import ZaberServer
from tests.drivers.stages.stage_kit import Answer, StageKit, Tamper, untampered
from tests.tcp_servers import zaber_on_tcp


class ZaberLine(ZaberServer):
    """A simulated stage on a pseudo-terminal. A test can read, change, lose or delay each message."""

    def __init__(self, device: StageDevice) -> None:
        self.received: list[str] = []
        self.tamper: Tamper = untampered
        super().__init__(device)

    def answer(self, line: bytes) -> bytes:
        command = line.decode().partition(":")[0].partition(" ")[2].partition(" ")[2].partition(" ")[2]
        self.received.append(command)
        return self.tamper(command, lambda: super(ZaberLine, self).answer(line))

    def motions(self) -> list[str]:
        return [command for command in self.received if command.startswith(("move", "home"))]


def settings(port: str, **changes: object) -> ZaberSettings:
    values = {"port": port, "angle_min_deg": -5.0, "angle_max_deg": 725.0, "reply_timeout_s": 5.0}
    return ZaberSettings.model_validate(values | changes)


def lose(lost: str) -> Tamper:
    """Return a function `Tamper`: the stage executes commands that begin with `lost`, without an answer."""

    def tamper(command: str, answer: Answer) -> bytes:
        reply = answer()
        return b"" if command.startswith(lost) else reply

    return tamper


def answered(reply: bytes, words: str) -> bytes:
    """Return the answer with other words after its id, and with the right checksum."""
    body = " ".join([*reply.decode()[1:].split()[:3], words])
    return f"@{body}:{lrc(body)}\r\n".encode()


ZABER = StageKit(
    open_stage,
    settings,
    lambda device, clock: ZaberLine(device),
    lambda device, clock: zaber_on_tcp(device),
)
