"""The third party's simulation of its load frame: the microcontroller's lines on a pseudo-terminal."""

from drivers.clock import Clock
from simulators.load_frame.device import LoadFrameDevice
from simulators.load_frame.faults import load_frame_faults
from simulators.load_frame.state import FaultCode, MachineLimits, RefusedError
from simulators.wire.faults import LOAD_FRAME, FaultPanel
from simulators.wire.ports import LineServer, port_of

STIFFNESS_N_MM = 5000.0


class Spring:
    """A specimen that stretches like a spring."""

    def stretch_to(self, displacement_mm: float) -> float:
        """Return the load at a displacement."""
        return STIFFNESS_N_MM * displacement_mm

    def break_now(self) -> None:
        """A spring does not break."""


class HeronMachine(LineServer):
    """The machine on a pseudo-terminal. `device` is its mechanics, `motions` counts its motions."""

    line_max = 128

    def __init__(self, clock: Clock) -> None:
        super().__init__()
        self.clock = clock
        self.device = LoadFrameDevice(clock, Spring())
        self.faults = load_frame_faults(FaultPanel(LOAD_FRAME), self.device)
        self.motions = 0
        self._limits = ""
        self._port = port_of(self, None, 0)

    def answer(self, line: bytes) -> bytes:
        """Execute one line and return the answer."""
        answer = self._answer(line.decode("ascii", "replace"))
        return f"{answer}\n".encode("ascii") if answer else b""

    def damaged(self, reply: bytes) -> bytes:
        """Return a damaged copy of the answer."""
        return bytes([reply[0] | 0x80]) + reply[1:]

    def readdressed(self, reply: bytes) -> bytes:
        """Return the answer unchanged, because the lines have no address."""
        return reply

    def _answer(self, line: str) -> str:
        name, *words = line.split()
        try:
            match name:
                case "ID?":
                    return "HERON HF5 SN0042 1.3"
                case "S?":
                    return self._status()
                case "LIM":
                    low_n, high_n, low_mm, high_mm, speed_mm_s = map(float, words)
                    limits = MachineLimits(low_n, high_n, low_mm, high_mm, speed_mm_s, 1000.0)
                    self.device.set_limits(limits)
                    self._limits = " ".join(words)
                case "LIM?":
                    return self._limits
                case "GO":
                    self.device.go_to_displacement(*map(float, words))
                    self.motions += 1
                case "SPD":
                    self.device.change_speed(float(words[0]))
                    self.motions += 1
                case "TARE":
                    self.device.tare()
                case "HOLD":
                    self.device.hold()
                    return ""
                case _:
                    return "NO unknown"
        except RefusedError as refused:
            return f"NO {refused}"
        return "OK"

    def _status(self) -> str:
        now = self.device.read()
        fault = "ESTOP" if now.estop else "-" if now.fault is FaultCode.NONE else now.fault.name
        state = "MOVE" if now.moving else "DONE" if now.at_target else "HOLD"
        return f"S {now.sample} {now.load_n:.2f} {now.displacement_mm:.5f} {state} {fault} {self.motions}"
