"""Serial port to which Zaber devices are connected. Each answer goes to the thread that sent the request.

A separate thread reads the port and assigns every answer to its request by the id of the answer. Therefore a
stop never waits for the answer to another request. Only one thread at a time writes a message. A message has
only a few bytes.
"""

import math
import queue
import re
import secrets
import threading
from collections import deque
from collections.abc import Callable

from drivers.clock import SystemClock
from drivers.errors import DeviceTimeout
from drivers.lines.channel import CHANNEL_ERRORS, Channel
from drivers.stages.port import StagePort
from drivers.stages.zaber.protocol import IDS, DamagedLineError, Reply, decode, encode

BAUD = 115_200
READ_WAIT_S = 0.05
LINE_MAX = 512
NEWER_S = 0.1
SHOWN_MAX = 80

Answer = Reply | DamagedLineError | None


class ZaberPort(StagePort):
    """An exclusive port to Zaber devices. No other program can use it, and any thread may call `ask`."""

    def __init__(self, name: str, channel: Channel, reply_timeout_s: float) -> None:
        super().__init__(name, channel, reply_timeout_s)
        self._waiting: dict[int, queue.SimpleQueue[Answer]] = {}
        # begin at a random id, because two programs on one line should not use the same ids
        self._next_id = secrets.randbelow(len(IDS))
        self._used: deque[int] = deque(maxlen=len(IDS) // 2)
        self.foreign = ""
        self._closing = False
        self._reader = threading.Thread(target=self._read, name=f"read {name}", daemon=True)
        self._reader.start()

    def ask(
        self,
        address: int,
        axis: int,
        command: str,
        *,
        permit: Callable[[], None] | None = None,
        at_most_s: float = math.inf,
        attempts: int = 1,
    ) -> Reply:
        """Send one command and return its answer.

        If the command may be repeated, a late answer to an earlier attempt is accepted during a call. Outside
        a call, as on opening, late answers are ignored, so that a stage whose answers all come late is
        reported.

        Parameters
        ----------
        address, axis : int
        command : str
            Command to the device. An empty command asks for the status.
        permit : callable, optional
            Function that is called just before the bytes are sent. If the function raises, nothing is sent.
        at_most_s : float
            Upper limit of the wait for an answer, in seconds, even if the reply timeout is longer.
        attempts : int
            How often the command may be sent. A motion command may be sent only once.

        Raises
        ------
        DeviceTimeout
            If no complete answer came in time. The device may still have executed the command.
        LinkLost
            If the connection to the device is lost.
        """
        answers: queue.SimpleQueue[Answer] = queue.SimpleQueue()
        said, wait_s = command or "status request", min(self._reply_timeout_s, at_most_s)
        ids: list[int] = []
        try:
            for attempt in range(attempts):
                last = attempt == attempts - 1
                ids.append(self._post(answers, address, axis, command, said, permit))
                timeout_s = (
                    self.call_time.last_wait_s(wait_s)
                    if last and attempts > 1
                    else self.call_time.first_wait_s(wait_s)
                )
                try:
                    answer = self._answer(answers, said, timeout_s)
                except DeviceTimeout:
                    if last or self.call_time.left_s == 0:
                        raise
                    if not self.call_time.patient:
                        del self._waiting[ids.pop()]
                    continue
                return answer if answer.id == ids[-1] else self._newer(answers, said) or answer
        finally:
            for id in ids:
                del self._waiting[id]
        raise AssertionError("unreachable")

    def _newer(self, answers: "queue.SimpleQueue[Answer]", said: str) -> Reply | None:
        """Return the answer to the last attempt if it comes soon after a late answer to an earlier one."""
        try:
            return self._answer(answers, said, self.call_time.first_wait_s(NEWER_S))
        except DeviceTimeout:
            return None

    def _post(
        self,
        answers: "queue.SimpleQueue[Answer]",
        address: int,
        axis: int,
        command: str,
        said: str,
        permit: Callable[[], None] | None,
    ) -> int:
        """Send a message with a new id, and return the id. The answer goes to `answers`."""
        with self._write_lock:
            id = self._next_id = next(i for i in _after(self._next_id) if i not in self._waiting)
            self._waiting[id] = answers
            self._used.append(id)
            try:
                self._write(encode(address, axis, id, command), said, permit)
            except BaseException:
                del self._waiting[id]
                raise
            return id

    def _answer(self, answers: "queue.SimpleQueue[Answer]", said: str, timeout_s: float) -> Reply:
        try:
            answer = answers.get(timeout=timeout_s)
        except queue.Empty:
            raise self._timeout(said, timeout_s, "silence") from None
        if answer is None:
            raise self._link_lost(said)
        if isinstance(answer, DamagedLineError):
            raise self._timeout(said, timeout_s, f"the damaged line {str(answer)[:SHOWN_MAX]!r}")
        return answer

    def _read(self) -> None:
        buffer, clock = b"", SystemClock()
        while not self._closing:
            try:
                buffer += self._channel.receive(clock.now_s() + READ_WAIT_S)
            except CHANNEL_ERRORS as error:
                self._lost = self._lost or str(error)
                self._tell_all(None)
                return
            *lines, rest = re.split(rb"[\r\n]+", buffer)
            buffer = rest[-LINE_MAX:]
            for line in filter(None, lines):
                self._hand_over(line)

    def _hand_over(self, line: bytes) -> None:
        try:
            reply = decode(line)
        except DamagedLineError as damage:
            # The id in a damaged line may be wrong too. So pass the error to all requests that wait for an
            # answer.
            self._tell_all(damage)
            return
        if reply is not None and (answers := self._waiting.get(reply.id)) is not None:
            answers.put(reply)
        elif reply is not None and reply.id not in self._used:
            self.foreign = f"an answer to another program (id {reply.id})"

    def _tell_all(self, answer: Answer) -> None:
        for answers in list(self._waiting.values()):
            answers.put(answer)

    def close(self) -> None:
        """Release the port. A repeated call has no effect."""
        self._closing = True
        self._reader.join()
        self._lost = self._lost or "the port was closed"
        self._tell_all(None)
        self._channel.close()


def _after(id: int) -> list[int]:
    """Return all request ids in order, starting after `id`, so that each id is used again as late as
    possible."""
    return [*IDS[id + 1 :], *IDS[: id + 1]]
