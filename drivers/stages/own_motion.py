"""Compare the motions of a stage with the commands of this program, to notice commands of other programs."""

import threading

# A larger change of the angle between two readings at rest means that the stage was moved. The position
# control of a stage at rest changes the angle by less, and a step of a protocol changes it by more.
SHIFT_DEG = 0.05


class OwnMotion:
    """Record of the motion commands that this program sent to a stage. Any thread may use this object.

    Until the stage is first seen at rest, a motion may come from an earlier program and is not an error.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._commanded = True
        self._sending = False
        self._rest_deg: float | None = None
        self._foreign = ""

    def begin(self) -> None:
        """Record that a motion command is about to be sent."""
        with self._lock:
            self._commanded = self._sending = True
            self._rest_deg = None

    def sent(self) -> None:
        """Record that the command was sent or refused; its motion ends at the next reading at rest."""
        with self._lock:
            self._sending = False

    def acknowledge(self) -> None:
        """Delete the recorded sign of another program."""
        with self._lock:
            self._foreign = ""

    def note(self, foreign: str) -> None:
        """Record a sign that another program has commanded the stage."""
        with self._lock:
            self._foreign = self._foreign or foreign

    def see(self, angle_deg: float, *, moving: bool, referenced: bool) -> str:
        """Record a reading. Return the sign of another program's command, or an empty text if there is none.

        `referenced` is True if the stage has a reference position. Without a reference the angle may jump
        without a motion.
        """
        with self._lock:
            if self._sending:
                return self._foreign
            if moving:
                if not self._commanded:
                    self._foreign = self._foreign or "a motion that this program did not command"
                return self._foreign
            shift_deg = 0.0 if self._rest_deg is None or not referenced else angle_deg - self._rest_deg
            if abs(shift_deg) > SHIFT_DEG:
                self._foreign = (
                    self._foreign or f"an angle that changed by {shift_deg:.3g}° without a command"
                )
            self._commanded = False
            self._rest_deg = angle_deg if referenced else None
            return self._foreign
