"""Ask the operator the questions of a protocol. A program may give the answer too, through the engine."""

from threading import Lock

from drivers.interfaces import OperatorQuestion
from rig.engine.context import RunContext
from rig.engine.motion import RunMotion
from rig.errors import ProtocolError
from rig.protocol.step import ProtocolStep, RigReading
from rig.recorder.records import OPERATOR_DONE, STEP_REACHED


class Questions:
    """Asks the questions of one run. `open` is the question that waits for its answer, or None."""

    def __init__(self, run: RunContext, motion: RunMotion) -> None:
        self.open: OperatorQuestion | None = None
        self._run = run
        self._motion = motion
        self._lock = Lock()
        self._answered_by = ""

    def require_operator(self) -> None:
        """Raise `ProtocolError` if the operator's driver cannot ask the questions of the protocol."""
        asks = any(step.question is not None for step in self._run.protocol.steps())
        if asks and not hasattr(self._run.rig.operator, "ask"):
            raise ProtocolError(
                "a protocol with a phase ask",
                "an [operator] in the rig file who can be asked questions",
                "one whose driver has no method ask",
                'use driver = "console-operator", or add the method to the driver',
            )

    def ask(self, step: ProtocolStep, question: OperatorQuestion) -> RigReading:
        """Ask a question while nothing moves, and return the reading after the answer."""
        run = self._run
        self._motion.stand_for(step)
        run.log("info", f"the operator is asked: {question.text}")
        begun_s = run.clock.now_s()
        try:
            with self._lock:
                self.open, self._answered_by = question, ""
            run.check_abort()
            run.devices.operator.ask(question, lambda: bool(self._answered_by))
        finally:
            with self._lock:
                self.open = None
        # These marks end the wait for a replay, and the step for a run that is continued.
        run.mark(OPERATOR_DONE)
        waited_s = run.clock.now_s() - begun_s
        run.log("info", f'"{question.word}" by {self._answered_by or "the operator"} after {waited_s:.1f} s')
        run.mark(f"{STEP_REACHED} {step.index}")
        return run.read()

    def answer(self, word: str, who: str) -> str:
        """Answer the open question. Return why the answer is refused, or an empty text. Any thread may call.

        The words that confirm what a person does with the grid, or that nobody has touched the specimen, are
        not taken here, because they say that a person stands at the machine.
        """
        with self._lock:
            question = self.open
            if question is None:
                return "no question of the protocol waits for an answer"
            if not question.is_confirmed_by(word):
                return f'expected the word "{question.word}", got "{word}"'
            self._answered_by = who
        self._run.calls.interrupt()
        return ""
