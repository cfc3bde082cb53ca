"""Pass messages between a device and one program on this computer.

Some lines, such as a serial port, can be used by only one program. A guardian process then owns the line, and
the driver in another process sends its messages to the device through this relay. When the driver's process
dies or hangs, the guardian can use the line at once.
"""

import os
import select
import socket
import threading
from collections.abc import Callable

from drivers.lines.channel import CHANNEL_ERRORS, CHUNK, Channel

LOCALHOST = "127.0.0.1"
BUFFER_MAX = 4096

Cut = Callable[[bytes], int]
"""Type of a function that gets the bytes sent by the program and returns how many of them form complete
messages."""


def whole_lines(ends: bytes) -> Cut:
    """Return a function of type `Cut` for messages that end with any one of the bytes in `ends`."""

    def cut(buffer: bytes) -> int:
        return 1 + max(buffer.rfind(ends[place : place + 1]) for place in range(len(ends)))

    return cut


class Relay:
    """The owner of the channel to a device. One program on this computer connects to the relay.

    Only complete messages are passed to the device. If a program is killed while it sends a message, this
    message never reaches the device. Bytes from the device are passed to the program without delay.

    ``open_channel()`` opens the channel to the device, at the start and again after a lost connection.
    ``cut(data)`` returns how many bytes at the start of `data` form complete messages. `fresh` is True to
    open the channel again for every new program, so that a late answer to one program does not reach the next
    program. `address` is the address ``host:port`` to which the program connects.
    """

    def __init__(self, open_channel: Callable[[], Channel], cut: Cut, *, fresh: bool = False) -> None:
        self._open_channel = open_channel
        self._cut = cut
        self._fresh = fresh
        self._used = False
        self._channel: Channel | None = None
        self._client: socket.socket | None = None
        self._listener: socket.socket | None = None
        self._thread: threading.Thread | None = None
        self.address = ""

    def channel(self) -> Channel:
        """Return the channel to the device, for use by the owner of the relay. Open the channel if needed.

        The owner may use the channel only while the relay passes no messages. Closing the returned channel
        does not close the line. Raise `OSError` or `termios.error` if the channel cannot be opened.
        """
        self._opened()
        return _Lent(self._opened)

    def _opened(self) -> Channel:
        if self._channel is None:
            self._channel = self._open_channel()
        return self._channel

    def drop_channel(self) -> None:
        """Close the channel to the device. The method `channel` opens it again."""
        channel, self._channel = self._channel, None
        if channel is not None:
            channel.close()

    def begin(self) -> None:
        """Start to listen for a program and to pass messages."""
        self._listener = socket.create_server((LOCALHOST, 0))
        self.address = "{}:{}".format(*self._listener.getsockname()[:2])
        self._wake, self._waker = os.pipe()
        self._thread = threading.Thread(target=self._pass_on, name=f"relay {self.address}", daemon=True)
        self._thread.start()

    def take_over(self) -> None:
        """Stop passing messages, and refuse all programs from now on. A repeated call has no effect."""
        thread, self._thread = self._thread, None
        if thread is None:
            return
        os.write(self._waker, b"!")
        thread.join()
        os.close(self._wake)
        os.close(self._waker)

    def close(self) -> None:
        """Stop passing messages, and close the line to the device. A repeated call has no effect."""
        self.take_over()
        self.drop_channel()

    def _pass_on(self) -> None:
        assert self._listener is not None
        with self._listener as listener:
            while self._wake not in _readable([self._wake, listener.fileno()]):
                try:
                    client, _ = listener.accept()
                except OSError:
                    # ignore a program that has closed its connection already
                    continue
                with client:
                    if not self._serve(client):
                        return

    def _serve(self, client: socket.socket) -> bool:
        """Pass messages in both directions. Return False when the owner of the relay takes over the line.

        If the connection to the program or to the device is lost, the result is True.
        """
        client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        client.setblocking(False)
        try:
            if self._fresh and self._used:
                self.drop_channel()
            self._used = True
            channel = self._opened()
            # discard old answers of the device to an earlier program
            channel.drain()
            return self._converse(client, channel)
        except CHANNEL_ERRORS:
            self.drop_channel()
            return True

    def _converse(self, client: socket.socket, channel: Channel) -> bool:
        received = b""
        while True:
            ready = _readable([self._wake, client.fileno(), channel.fileno()])
            if self._wake in ready:
                return False
            if channel.fileno() in ready and not _given(client, channel.receive(0.0)):
                return True
            if client.fileno() in ready:
                if not (data := _taken(client)):
                    return True
                received += data
                whole = self._cut(received)
                if whole:
                    channel.send(received[:whole])
                received = received[whole:][-BUFFER_MAX:]


def _given(client: socket.socket, data: bytes) -> bool:
    """Send bytes to the program. Return False if the program has closed the connection or does not read."""
    try:
        return client.send(data) == len(data) if data else True
    except OSError:
        return False


def _taken(client: socket.socket) -> bytes:
    """Return the bytes that the program sent. Return no bytes if the program closed the connection."""
    try:
        return client.recv(CHUNK)
    except OSError:
        return b""


class _Lent(Channel):
    """The channel of a relay, as given to the relay's owner. Its method `close` leaves the line open."""

    def __init__(self, opened: Callable[[], Channel]) -> None:
        self._opened = opened
        super().__init__(self)

    def fileno(self) -> int:
        return self._opened().fileno()

    def send(self, data: bytes) -> None:
        self._opened().send(data)

    def discard(self) -> None:
        self._opened().discard()

    def close(self) -> None:
        pass


def _readable(descriptors: list[int]) -> list[int]:
    waiting = select.poll()
    for descriptor in descriptors:
        waiting.register(descriptor, select.POLLIN)
    return [descriptor for descriptor, _ in waiting.poll()]
