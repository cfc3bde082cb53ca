"""Messages between a program and its worker processes: pickled objects, through pipes."""

import pickle
from collections.abc import Sequence
from typing import Any, BinaryIO

Message = Sequence[bytes | bytearray | memoryview]
"""The parts of a message: a pickled object, and then the arrays that it contains."""

_NUMBER_BYTES, _PIPE_BYTES = 8, 2**20


def widen(pipe: BinaryIO) -> None:
    """Let a pipe hold a megabyte, if the system can: the writer then waits less for the reader."""
    try:
        import fcntl

        fcntl.fcntl(pipe, fcntl.F_SETPIPE_SZ, _PIPE_BYTES)
    except (ImportError, AttributeError, OSError):
        # The pipe keeps its size: the system has no such call, or its user has too many wide pipes.
        return


def packed(value: object) -> Message:
    """Return the message for an object; its arrays are not copied, so they must not change any more."""
    arrays: list[pickle.PickleBuffer] = []
    content = pickle.dumps(value, protocol=5, buffer_callback=arrays.append)
    return [content, *(array.raw() for array in arrays)]


def unpacked(message: Message) -> Any:
    """Return the object of a message. Its arrays use the memory of the message."""
    content, *arrays = message
    return pickle.loads(content, buffers=arrays)


def send(pipe: BinaryIO, message: Message) -> None:
    """Write a message; raise `OSError` if the other process has ended."""
    for number in (len(message), *map(len, message)):
        pipe.write(number.to_bytes(_NUMBER_BYTES, "big"))
    for part in message:
        pipe.write(part)
    pipe.flush()


def receive(pipe: BinaryIO) -> Message:
    """Read a message; raise `EOFError` if the other process has ended."""
    lengths = [_number(pipe) for _ in range(_number(pipe))]
    return [_exactly(pipe, length) for length in lengths]


def _number(pipe: BinaryIO) -> int:
    return int.from_bytes(_exactly(pipe, _NUMBER_BYTES), "big")


def _exactly(pipe: BinaryIO, count: int) -> bytearray:
    # Arrays in a bytearray can be written, like all others.
    content, done = bytearray(count), 0
    with memoryview(content) as rest:
        while done < count:
            more = pipe.readinto(rest[done:])  # type: ignore[attr-defined]
            if not more:
                raise EOFError
            done += more
    return content
