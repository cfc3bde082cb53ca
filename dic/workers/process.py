"""The program of a worker process: it runs functions that another process sends, until the pipe is closed.

python -m dic.workers.process THREADS
"""

import os
import pickle
import sys

from dic.image.threads import limited_to
from dic.workers.pipes import receive, send


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


def _answer(task: bytes) -> bytes:
    """Return the pickled result of a pickled function and arguments, or the error that was raised."""
    try:
        function, arguments, named = pickle.loads(task)
        return pickle.dumps((function(*arguments, **named), None), protocol=5)
    except Exception as error:
        # Raised again in the program that has sent the function.
        return pickle.dumps((None, error), protocol=5)


if __name__ == "__main__":
    main()
