"""Measure how fast machines stop after a failure of `rig run`, by the log of `rig simulate`."""

import json
import math
import os
import random
import signal
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from statistics import median

from rig.devices import open_rig
from rig.rigfile import read_rig
from tests.command_line import RIG as RIG_PROGRAM, Program

DEADLINE_S = 60.0
PERIOD_S = 0.002
# A stage brakes at 1000 deg/s² here: from 10 deg/s in 10 ms. The grips do not slip, so an unloaded specimen
# is as before, and the next run does not end at the slack that a slip would have left.
SIMULATION = """[simulation]
driver = "virtual-rig"
specimen.grip_slip_mm = 0.0
"""
RIG = (
    f"""
[rig]
name = "stop times"
{SIMULATION}"""
    + """[stage]
driver = "zaber-ascii"
port = "@{stage}"
angle_min_deg = -5.0
angle_max_deg = 365.0
speed_deg_s = 10.0
acceleration_deg_s2 = 1000.0
reply_timeout_s = 60.0
[load_frame]
driver = "modbus-frame"
address = "@{load_frame}"
load_max_n = 14000.0
displacement_max_mm = 6.0
reply_timeout_s = 60.0
[cameras.front]
driver = "simulated-camera"
width_px = 48
height_px = 32
[operator]
driver = "simulated-operator"
duration_s = 0.0
"""
)
COMMON = """
title = "stop times"
[sample]
name = "plate"
thickness_mm = 1.0
width_mm = 25.0
gauge_length_mm = 60.0
"""
TENSION = (
    'kind = "tension"'
    + COMMON
    + """
[loading]
increment_n = 2000.0
increments_max = 5
rate_n_s = 200.0
tare_max_n = 100.0
plastic = { stiffness_fraction = 0.8, judged_above_n = 4000.0 }
[stretching]
increment_mm = 0.3
total_mm = 5.0
speed_mm_s = 0.02
[settle]
load_tolerance_n = 20.0
displacement_tolerance_mm = 0.002
dwell_s = 0.1
timeout_s = 60.0
poll_s = 0.1
[limits]
load_max_n = 13000.0
displacement_max_mm = 5.2
break_load_drop = 0.3
"""
)
ROTATION = (
    'kind = "rotation"'
    + COMMON
    + """
[rotation]
increment_deg = 90.0
total_deg = 360.0
[settle]
angle_tolerance_deg = 0.01
dwell_s = 0.1
timeout_s = 60.0
poll_s = 0.1
"""
)


@dataclass(frozen=True)
class Machine:
    """A machine: its name, the protocol that moves it, the command that begins the motion, the log's key."""

    name: str
    protocol: str
    begins: str
    value: str


FRAME = Machine("load_frame", TENSION, "load ", "displacement_mm")
STAGE = Machine("stage", ROTATION, "move 576000", "angle_deg")


@dataclass
class Times:
    """Measured times in ms from an event to the standstill of a machine."""

    machine: str
    event: str
    ms: list[float] = field(default_factory=list)

    def __str__(self) -> str:
        return (
            f"{self.event} · {self.machine}: median {median(self.ms):.0f} ms, "
            f"worst {max(self.ms):.0f} ms of {len(self.ms)}"
        )


def wait_for_end(pid: int) -> None:
    """Wait until a killed process has ended and has released its ports; it is no child of this process."""
    end_s = time.monotonic() + DEADLINE_S
    while time.monotonic() < end_s:
        try:
            state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
        except (FileNotFoundError, ProcessLookupError):
            return
        if state in "ZX":
            return
        time.sleep(PERIOD_S)
    raise AssertionError(f"process {pid} does not end")


TAIL_BYTES = 1 << 16
"""Number of bytes, larger than the longest line of the log."""


class Bench:
    """A simulated rig in a separate process, on which runs are executed one after the other.

    `rig` is the text of its rig file. `machines` have the protocols of the runs, which `program` executes.
    """

    program: Sequence[str] = RIG_PROGRAM

    def __init__(
        self, folder: Path, rig: str, machines: Iterable[Machine], period_s: float = PERIOD_S
    ) -> None:
        self.folder = folder
        self._rng = random.Random(11)
        (folder / "rig.toml").write_text(rig)
        for machine in machines:
            (folder / f"{machine.name}.toml").write_text(machine.protocol)
        options = ("-o", folder / "use.toml", "--log", folder / "log", "--period-s", period_s)
        self.simulation = Program("simulate", folder / "rig.toml", *options)
        self.simulation.wait_for("scene: ")
        self._log = (folder / "log").open("rb")

    def close(self) -> None:
        self._log.close()
        self.simulation.close()

    def entries(self) -> Iterator[dict]:
        """Yield the entries of the simulation's log, which has the true state, as they are written."""
        end_s, rest = time.monotonic() + DEADLINE_S, b""
        while time.monotonic() < end_s:
            rest += self._log.readline()
            if not rest.endswith(b"\n"):
                time.sleep(PERIOD_S)
                continue
            yield json.loads(rest)
            rest = b""
        raise AssertionError("the log shows nothing more")

    def stand_after_ms(self, machine: Machine, event: Callable[[Program], float | None]) -> float:
        """Return the time, ms, from an event during a motion to the final standstill of the machine.

        The function `event` causes the event, and returns its time. If it returns None, the time of its call
        counts.
        """
        with closing(self.started(machine)) as run:
            time.sleep(self._rng.uniform(0.1, 0.5))
            stood_ms = self.stood_after_ms(machine, run, event)
            self._end(run)
        return stood_ms

    def stood_after_ms(
        self, machine: Machine, run: Program, event: Callable[[Program], float | None]
    ) -> float:
        """Cause an event of a run whose machine moves, and return the time from it to the standstill, ms."""
        self._skip_to_end()
        before_s = time.monotonic()
        began_s = event(run) or before_s
        stood_s = self.wait_for_standstill(machine, began_s)
        assert stood_s > began_s, f"{machine.name} stood before the event"
        return 1000.0 * (stood_s - began_s)

    def started(self, machine: Machine) -> Program:
        """Start a run on an unloaded rig, and return it when the motion that is to be stopped has begun."""
        self.unload()
        run = Program(*self.command(machine), command=self.program)
        try:
            self._wait_for_motion(run, machine)
        except BaseException:
            run.close()
            raise
        return run

    def command(self, machine: Machine) -> tuple[object, ...]:
        """Return the command line of a run with a new run file."""
        for file in self.folder.glob("run.*"):
            file.unlink()
        protocol, rig_file = self.folder / f"{machine.name}.toml", self.folder / "use.toml"
        return "run", protocol, "--rig", rig_file, "-o", self.folder / "run.h5"

    def _wait_for_motion(self, run: Program, machine: Machine) -> None:
        self._skip_to_end()
        for entry in self.entries():
            if entry["what"] == "command" and entry["command"].startswith(machine.begins):
                return
            assert run.process.poll() is None, run.process.stderr.read()

    def _skip_to_end(self) -> None:
        """Skip the log up to the end of its last complete line, because the newest line may be incomplete."""
        end = self._log.seek(0, os.SEEK_END)
        start = max(0, end - TAIL_BYTES)
        self._log.seek(start)
        self._log.seek(start + self._log.read(end - start).rfind(b"\n") + 1)

    def wait_for_standstill(self, machine: Machine, began_s: float) -> float:
        """Return the time of standstill: of the last change of the machine's value, but not before the stop.

        The simulated crosshead moves in steps of 20 ms, so it can stand still by chance before the hold
        command arrives.
        """
        last, changed_s, told_s = None, began_s, None
        for entry in self.entries():
            if entry["time_s"] < began_s:
                continue
            if entry["what"] == "command" and entry["command"] in ("hold", "stop") and told_s is None:
                told_s = entry["time_s"]
            if entry["what"] != "sample":
                continue
            if entry[machine.value] != last:
                last, changed_s = entry[machine.value], entry["time_s"]
            if entry["time_s"] > changed_s + 1.0:
                return max(changed_s, told_s or 0.0)
        raise AssertionError("unreachable")

    def stands(self, machine: Machine) -> bool:
        """Return True if a machine comes to rest within 1.5 s."""
        began_s = time.monotonic()
        return self.wait_for_standstill(machine, began_s) < began_s + 1.5

    def _end(self, run: Program) -> None:
        guardian = guardian_of(run)
        for pid in (guardian, run.process.pid):
            # either may have ended by itself meanwhile
            if pid is not None:
                with suppress(ProcessLookupError):
                    os.kill(pid, signal.SIGKILL)
        run.process.wait(DEADLINE_S)
        if guardian is not None:
            wait_for_end(guardian)

    def unload(self) -> None:
        """Clear all faults, stop the machines, and unload the specimen."""
        self.simulation.type("clear")
        self.simulation.wait_for("on: ")
        with open_rig(read_rig(self.folder / "use.toml")) as rig:
            if rig.stage is not None:
                rig.stage.stop()
            rig.load_frame.hold()
            rig.load_frame.go_to_displacement(0.0, 1.0)
            while rig.load_frame.read().moving:
                time.sleep(0.05)


@contextmanager
def bench(folder: Path, stage: str = "stage", load_frame: str = "load_frame") -> Iterator[Bench]:
    with ExitStack() as stack:
        text = RIG.format(stage=stage, load_frame=load_frame)
        yield stack.enter_context(closing(Bench(folder, text, (FRAME, STAGE))))


def guardian_of(run: Program) -> int | None:
    """Return the process number of a run's guardian, or None if there is no guardian."""
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            command = (folder / "cmdline").read_bytes()
            parent = (folder / "stat").read_text().rpartition(")")[2].split()[1]
        except OSError:
            continue
        if b"rig.guardian.process" in command and int(parent) == run.process.pid:
            return int(folder.name)
    return None


def signals(bench: Bench, machine: Machine) -> Callable[[Program], None]:
    chosen = iter([signal.SIGINT, signal.SIGTERM, signal.SIGHUP] * 100)
    return lambda run: run.process.send_signal(next(chosen))


def kill(bench: Bench, machine: Machine) -> Callable[[Program], None]:
    return lambda run: run.process.kill()


def hang(bench: Bench, machine: Machine) -> Callable[[Program], None]:
    return lambda run: run.process.send_signal(signal.SIGSTOP)


def hanging_call(bench: Bench, machine: Machine) -> Callable[[Program], None]:
    """Return an event: a request to the machine is lost, so that the driver's call waits for its answer."""
    return lambda run: bench.simulation.type(f"fault {machine.name}.lose-request:1")


def all_frozen(bench: Bench, machine: Machine) -> Callable[[Program], None]:
    def freeze(run: Program) -> None:
        os.kill(guardian_of(run), signal.SIGSTOP)
        run.process.send_signal(signal.SIGSTOP)

    return freeze


EVENTS = {
    "signal": (signals, 100.0),
    "kill -9": (kill, 50.0),
    "engine hangs": (hang, 1000.0),
    "driver call hangs": (hanging_call, 1000.0),
}
FROZEN_MS = 2000.0 + 50.0
"""Limit in ms: the watchdog's time, and 2.5 control periods in which the machine notices its end."""


def measure(bench: Bench, machine: Machine, name: str, count: int, bound_ms: float = math.inf) -> Times:
    """Measure the stop time after an event `count` times.

    If `bound_ms` is given, the measurement ends as soon as the median of `count` times is certainly within
    this bound. For a median of three, two times within the bound are enough.
    """
    make = all_frozen if name == "all frozen" else EVENTS[name][0]
    event, times = make(bench, machine), Times(machine.name, name)
    for _ in range(count):
        times.ms.append(bench.stand_after_ms(machine, event))
        if bound_ms < math.inf and 2 * sum(ms <= bound_ms for ms in times.ms) > count:
            break
    return times
