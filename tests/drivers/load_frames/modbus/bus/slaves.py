"""A device on a serial line for tests of Modbus RTU, and a link to it."""

import os
import threading
import tty
from collections.abc import Callable, Iterator

from drivers.load_frames.modbus.bus.address import ModbusAddress
from drivers.load_frames.modbus.bus.link import ModbusLink
from drivers.load_frames.modbus.bus.wire import crc

# long enough for a busy machine; tests that wait in vain take less
LONG_S, SHORT_S = 10.0, 0.2


class Slave:
    """A device on a serial line, whose answers a function of the test gives. Frames arrive in one piece."""

    def __init__(self, answer: Callable[[bytes], bytes]) -> None:
        self.answer = answer
        self.requests: list[bytes] = []
        self._near, self._far = os.openpty()
        tty.setraw(self._far)
        self.path = os.ttyname(self._far)
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()

    def _serve(self) -> None:
        # the end may come together with a request that was not read yet
        while not (request := os.read(self._near, 300)).endswith(b"end"):
            self.requests.append(request)
            os.write(self._near, self.answer(request))

    def say(self, data: bytes) -> None:
        """Send bytes without a request."""
        os.write(self._near, data)

    def close(self) -> None:
        os.write(self._far, b"end")
        self._thread.join()
        os.close(self._far)
        os.close(self._near)


def framed(text: str) -> bytes:
    body = bytes.fromhex(text)
    return body + crc(body)


def linked(slave: Slave, reply_timeout_s: float, *, echo: bool = False) -> Iterator[ModbusLink]:
    made = ModbusLink("frame", ModbusAddress(slave.path, echo=echo), unit=1, reply_timeout_s=reply_timeout_s)
    yield made
    made.close()
