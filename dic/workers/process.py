"""The program of a worker process: it runs functions that another process sends, until the pipe is closed.

python -m dic.workers.process THREADS
"""

import os
import sys

from dic.image.threads import limited_to
from dic.workers.pipes import Message, packed, receive, send, unpacked


def main() -> None:
    """Run the functions that arrive on standard input, and send their results back."""
    # Answers go through a copy of standard output, and anything that a library prints goes to standard error.
    with os.fdopen(os.dup(1), "wb") as answers, limited_to(int(sys.argv[1])):
        os.dup2(2, 1)
        while True:
            try:
                task = receive(sys.stdin.buffer)
            except EOFError:
                return
            try:
                send(answers, _answer(task))
            except BrokenPipeError:
                return


def _answer(task: Message) -> Message:
    """Return the result of a function with its arguments, or the error that was raised."""
    try:
        function, arguments, named = unpacked(task)
        return packed((function(*arguments, **named), None))
    except Exception as error:
        # Raised again in the program that has sent the function.
        return packed((None, error))


if __name__ == "__main__":
    main()
