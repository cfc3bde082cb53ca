"""Messages between a program and its worker processes: bytes with their length, through pipes."""

from typing import BinaryIO

_LENGTH_BYTES = 8


def send(pipe: BinaryIO, message: bytes) -> None:
    """Write a message; raise `OSError` if the other process has ended."""
    pipe.write(len(message).to_bytes(_LENGTH_BYTES, "big"))
    pipe.write(message)
    pipe.flush()


def receive(pipe: BinaryIO) -> bytes:
    """Read a message; raise `EOFError` if the other process has ended."""
    return _exactly(pipe, int.from_bytes(_exactly(pipe, _LENGTH_BYTES), "big"))


def _exactly(pipe: BinaryIO, count: int) -> bytes:
    content = pipe.read(count)
    if len(content) < count:
        raise EOFError
    return content
