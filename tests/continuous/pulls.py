"""Continuous tension tests on a virtual rig, beside what the simulation knows to be true.

The live gauges are real ones, which see rendered frames, or the true strain with noise, for hundreds of tests
in which only the engine, the machine and the record matter.
"""

import random
import tomllib
from collections.abc import Callable
from contextlib import AbstractContextManager, ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np

import rig.run as runs
from drivers.clock import Clock
from drivers.interfaces import Frame
from drivers.settings import toml_table
from rig.devices import Rig
from rig.engine.status import Outcome
from rig.live.values import GaugeValue, LiveReading
from simulators.rig.camera import SimulatedCamera
from simulators.rig.virtual_rig import VirtualRig

RATE_S, LENGTH_MM, AREA_MM2 = 0.00025, 60.0, 25.0
CALL_S = 45.0
"""Deadline of calls: on a busy computer simulated time must not pass for want of processor time."""
STEEL = {
    "youngs_modulus_mpa": 205_000.0,
    "poisson_ratio": 0.29,
    "machine_stiffness_n_mm": 30_000.0,
    "grip_slip_mm": 0.1,
    "fracture_strain": 0.25,
    "hardening": {"law": "swift", "strength_mpa": 780.0, "offset_strain": 0.004, "exponent": 0.14},
}
TINY = {"width_px": 64, "height_px": 64, "focal_px": 800.0, "distance_mm": 80.0, "fps": 10.0}
SEES = {"width_px": 400, "height_px": 400, "focal_px": 2000.0, "distance_mm": 60.0, "fps": 10.0}
GAUGE = "axial=extensometer start=200,80 end=200,320 patch=60"

PULL = """
kind = "phases"
title = "a continuous test of the campaign"
[sample]
name = "sheet"
thickness_mm = 1.0
width_mm = 25.0
gauge_length_mm = 60.0
[start]
tare_max_n = 20.0
[settle]
load_tolerance_n = 20.0
displacement_tolerance_mm = 0.002
dwell_s = 0.5
timeout_s = 30.0
poll_s = 0.05
[limits]
load_max_n = 24000.0
displacement_max_mm = 19.0
break_load_drop = 0.5
"""

AT_RATE = f"""
[[phases]]
do = "preload"
load_n = 200.0
rate_n_s = 100.0
[[phases]]
do = "pull"
displacement_mm = 18.0
elastic_n = 3000.0
images.every_s = 0.5
[[phases.stages]]
strain_rate_s = {RATE_S}
gauge = "axial"
parallel_length_mm = {LENGTH_MM}
"""
"""Phases that end with a stage under a strain rate, whose other keys follow."""
LIVE = f"""
[live]
gauges = ["{GAUGE}"]
subset_px = 31
motion = "free"
"""


@dataclass
class TrueGauge:
    """A measurement of the gauge "axial" that knows the true strain, and adds noise. A `LiveMeasurement`."""

    cameras: dict[str, SimulatedCamera]
    clock: Clock
    noise: float
    rng: random.Random
    failed: str = ""
    left_out: int = 0
    found: list[LiveReading] = field(default_factory=list)

    def prepare(self, grids: Any, references: Any) -> None:
        """Need no images."""

    def offer(self, camera: str, frame: Frame) -> None:
        """Add a value of a frame."""
        shown = self.cameras[camera].shown
        strain = float(shown.deformation_gradient[1, 1]) - 1.0 + self.rng.gauss(0.0, self.noise)
        value = GaugeValue(strain, self.noise, True, "", "calibrated", camera)
        now_s = self.clock.now_s()
        self.found.append(
            LiveReading(frame.middle[0], 0.0, now_s, {camera: frame.sequence}, {"axial": value})
        )

    def take(self) -> list[LiveReading]:
        """Return the new values."""
        found, self.found = self.found, []
        return found

    def close(self) -> None:
        """Do nothing."""


@dataclass
class Pulled:
    """A finished test.

    `exposures` has one dict for each frame of the log of the truth (see `TruthLog`), `live` the readings of
    the live gauges that the engine took, `commands` time and name of what the load frame executed, `states`
    time in s, true load in N and true displacement in mm at each reading of the engine.
    """

    outcome: Outcome
    rig: VirtualRig
    path: Path
    exposures: list[dict[str, Any]]
    live: list[LiveReading]
    states: list[tuple[float, float, float]]

    @property
    def commands(self) -> list[tuple[float, str]]:
        return self.rig.load_frame.executed

    @property
    def strains(self) -> np.ndarray:
        """Times and true strains in the middle of the exposures, shape (n, 2)."""
        return np.array([(each["middle_s"], each["strain"]) for each in self.exposures])


def rig_text(cameras: dict[str, dict[str, Any]], specimen: dict[str, Any], **simulation: Any) -> str:
    """Return a rig file. Other keys are those of the table [simulation]. None leaves a key of `STEEL` out."""
    specimen = {key: value for key, value in (STEEL | specimen).items() if value is not None}
    tables = {
        "rig": {"name": "a rig of the campaign", "call_timeout_s": CALL_S},
        "simulation": {"driver": "virtual-rig", "specimen": specimen, **simulation},
        "load_frame": {
            "driver": "modbus-frame",
            "address": "@load_frame",
            "load_max_n": 25_000.0,
            "displacement_max_mm": 20.0,
            "reply_timeout_s": 20.0,
        },
        "mounting": {"shift_std_um": 1.0, "fixed_face": "front"},
        "operator": {"driver": "simulated-operator"},
    }
    parts = [toml_table([name], table) for name, table in tables.items()]
    driver = {"driver": "simulated-camera"}
    parts += [toml_table(["cameras", name], driver | each) for name, each in cameras.items()]
    return "\n\n".join(parts) + "\n"


def protocol_text(phases: str, live: str = "", head: str = PULL) -> str:
    """Return a protocol."""
    text = head + phases + live
    tomllib.loads(text)
    return text


def kept_rigs(rigs: list[VirtualRig]) -> AbstractContextManager[Any]:
    """Append each virtual rig that is built meanwhile."""
    build = VirtualRig.__init__

    def built(self: VirtualRig, *args: Any, **kwargs: Any) -> None:
        build(self, *args, **kwargs)
        rigs.append(self)

    return patch.object(VirtualRig, "__init__", built)


def kept_exposures(exposures: list[dict[str, Any]]) -> AbstractContextManager[Any]:
    """Append the truth of each exposure that is read out meanwhile."""
    read_out = SimulatedCamera._read_out

    def shown(self: SimulatedCamera, exposure: Any) -> Frame:
        frame = read_out(self, exposure)
        surface = exposure.surface
        exposures.append(
            {
                "camera": self.info.serial.removeprefix("cameras."),
                "sequence": frame.sequence,
                "begins_s": exposure.taken.begins_s,
                "middle_s": exposure.middle_s,
                "strain": float(surface.deformation_gradient[1, 1]) - 1.0,
                "load_n": surface.load_n,
                "texture": type(surface.texture).__name__,
            }
        )
        return frame

    return patch.object(SimulatedCamera, "_read_out", shown)


def kept_readings(
    live: list[LiveReading], noise: float | None, seed: int, on_live: Callable[[Any], None]
) -> AbstractContextManager[Any]:
    """Append each reading of the live gauges, which know the true strain with `noise`."""
    open_live = runs._open_live

    def opened(protocol: Any, rig_file: Any, devices: Rig, stack: ExitStack) -> Any:
        measurement = open_live(protocol, rig_file, devices, stack)
        if measurement is None:
            return None
        if noise is not None:
            measurement = TrueGauge(dict(devices.cameras), devices.clock, noise, random.Random(seed))
        take = measurement.take

        def taken() -> list[LiveReading]:
            found = take()
            live.extend(found)
            return found

        measurement.take = taken
        on_live(measurement)
        return measurement

    return patch.object(runs, "_open_live", opened)


def drive(
    folder: Path,
    protocol: str,
    rig_file: str,
    *,
    noise: float | None = None,
    seed: int = 0,
    look: Callable[[VirtualRig], None] = lambda _: None,
    on_live: Callable[[Any], None] = lambda _: None,
) -> Pulled:
    """Execute a test. With `noise`, the live gauge knows the true strain.

    `look` is called at each reading of the engine, and `on_live` with the measurement of the gauges.
    """
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "protocol.toml").write_text(protocol)
    (folder / "rig.toml").write_text(rig_file)
    rigs: list[VirtualRig] = []
    exposures: list[dict[str, Any]] = []
    live: list[LiveReading] = []
    states: list[tuple[float, float, float]] = []

    def on_progress(_may_move: bool) -> None:
        frame = rigs[0].load_frame
        states.append((rigs[0].clock.now_s(), frame.load_n(), frame.displacement_mm()))
        look(rigs[0])

    with kept_rigs(rigs), kept_exposures(exposures), kept_readings(live, noise, seed, on_live):
        outcome = runs.run_protocol(
            folder / "protocol.toml", folder / "rig.toml", folder / "run.h5", on_progress=on_progress
        )
    frame = rigs[0].load_frame
    states.append((rigs[0].clock.now_s(), frame.load_n(), frame.displacement_mm()))
    return Pulled(outcome, rigs[0], folder / "run.h5", exposures, live, states)
