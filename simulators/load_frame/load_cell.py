"""The load cell of a simulated load frame, and the ways in which a load cell can show a wrong load."""

from enum import Enum

from pydantic import Field

from drivers.settings import Settings


class Lie(Enum):
    """The kind of wrong reading of a load cell; the machine's own controller uses the wrong reading too."""

    NONE = "none"
    ZERO = "zero"
    TENTH = "tenth"
    REVERSED = "reversed"
    STUCK = "stuck"
    DRIFTING = "drifting"


class LoadCellSettings(Settings):
    """Noise and error of a load cell. A load cell of class 1 after ISO 7500-1 has an error of at most 1 %."""

    noise_n: float = Field(default=2.0, ge=0, description="standard deviation of a reading")
    error_percent: float = Field(default=0.0, ge=-5, le=5, description="error of the reading, % of the load")


class LoadCell:
    """A load cell that shows the real force with the error of its class, or a wrong force.

    `error_percent` is the error of each reading, % of the force. The machine's controller uses the reading
    too. `lie` is the present fault of the load cell.
    """

    def __init__(self, error_percent: float = 0.0) -> None:
        self._gain = 1.0 + error_percent / 100.0
        self.lie = Lie.NONE
        self._zero_n = 0.0
        self._stuck_n = 0.0
        self._drift_n_s = 0.0
        self._since_s = 0.0

    @property
    def is_stuck(self) -> bool:
        """True if the reading does not change at all, not even by noise."""
        return self.lie is Lie.STUCK

    def begin(self, lie: Lie, force_n: float, now_s: float, drift_n_s: float = 0.0) -> None:
        """Begin to show a wrong load; with `Lie.NONE` the load cell shows the real load again.

        `force_n` is the real force on the load cell in N, and `now_s` is the machine's time in s. For
        `Lie.DRIFTING`, `drift_n_s` is the rate at which the shown load falls below the real load, in N/s.
        """
        self._stuck_n = self._distorted(force_n, now_s)
        self.lie, self._since_s, self._drift_n_s = lie, now_s, drift_n_s

    def load_n(self, force_n: float, now_s: float) -> float:
        """Return the load in N that the load cell shows for a real force in N, at a time in s."""
        return self._distorted(force_n, now_s) - self._zero_n

    def tare(self, force_n: float, now_s: float) -> None:
        """Set the zero of the reading to the presently shown load."""
        self._zero_n = self._distorted(force_n, now_s)

    def reset(self) -> None:
        """Reset the zero of the reading, as after a power cut. The fault `lie` does not change."""
        self._zero_n = 0.0

    def _distorted(self, force_n: float, now_s: float) -> float:
        force_n *= self._gain
        match self.lie:
            case Lie.ZERO:
                return 0.0
            case Lie.TENTH:
                return 0.1 * force_n
            case Lie.REVERSED:
                return -force_n
            case Lie.STUCK:
                return self._stuck_n
            case Lie.DRIFTING:
                return force_n - self._drift_n_s * (now_s - self._since_s)
            case _:
                return force_n
