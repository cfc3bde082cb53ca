"""Write the true state, the commands, the frames and the faults of a virtual rig to a JSON lines file."""

import json
import threading
from contextlib import suppress
from dataclasses import asdict
from datetime import timedelta
from pathlib import Path
from typing import Any, Protocol

from drivers.clock import Clock
from drivers.interfaces import Frame
from simulators.rig.camera import SimulatedCamera
from simulators.rig.virtual_rig import VirtualRig


class _Commanded(Protocol):
    """A device that remembers the time and the name of each command that it executed."""

    @property
    def executed(self) -> list[tuple[float, str]]:
        """The executed commands."""


class TruthLog:
    """A log file with one line, a JSON object, for each sample, command, frame and fault.

    Every line has the key ``what`` (``specimen``, ``sample``, ``command``, ``frame``, ``fault``, or
    ``picture`` for the first exposure of a camera that shows a fault, or is lost by it), the time
    ``time_s`` of the rig's clock, and the date ``utc``. The first line has the exact material properties of
    the specimen. A sample has the values of `VirtualRig.truth`. A frame has the pose and the deformation
    gradient of the rendered surface, the load and the position of the crosshead, all in the middle of the
    exposure. `path` is the log file; None for no log. Raise `OSError` if the file cannot be written.
    """

    def __init__(self, path: Path | None, rig: VirtualRig) -> None:
        self._file = None if path is None else path.open("w", encoding="utf-8", buffering=1)
        self._rig = rig
        self._clock: Clock = rig.clock
        self._lock = threading.Lock()
        self._devices: dict[str, _Commanded] = {"stage": rig.stage, "load_frame": rig.load_frame}
        if rig.box is not None:
            self._devices["closed_machine"] = rig.box
        self._begun = self._first = 0
        self._told = dict.fromkeys(self._devices, 0)
        try:
            self.write("specimen", **rig.exact_properties)
        except OSError:
            if self._file is not None:
                # An open file would write the line again when Python frees it, and print the second error.
                with suppress(OSError):
                    self._file.close()
            raise

    def sample(self) -> None:
        """Write the current true state, and the commands to the devices since the last sample."""
        for name, device in self._devices.items():
            done = device.executed
            for time_s, command in done[self._told[name] :]:
                self.write("command", time_s=time_s, device=name, command=command)
            self._told[name] = len(done)
        self._write_pictures()
        self.write("sample", **self._rig.truth())

    def _write_pictures(self) -> None:
        """Write the planned faults and the first pictures with faults since the last sample."""
        begun, first = self._rig.plan.begun, self._rig.picture_faults.first
        for time_s, fault in begun[self._begun :]:
            self.write("fault", time_s=time_s, fault=fault, on=True)
        for each in first[self._first :]:
            self.write(
                "picture",
                time_s=each.taken.begins_s,
                fault=each.fault,
                since_s=each.since_s,
                camera=each.taken.camera,
                sequence=each.taken.sequence,
                exposure_s=each.taken.exposure_s,
            )
        self._begun, self._first = len(begun), len(first)

    def frame(self, name: str, camera: SimulatedCamera, frame: Frame) -> None:
        """Write the true state of the surface in a camera's frame."""
        exposure = camera.exposure_of(frame)
        shown = None if exposure is None else exposure.surface
        self.write(
            "frame",
            time_s=frame.exposed_s if exposure is None else exposure.taken.begins_s,
            camera=name,
            sequence=frame.sequence,
            flags=frame.flags,
            middle_s=frame.middle[0] if exposure is None else exposure.middle_s,
            faults=[] if exposure is None else list(exposure.faults),
            texture="" if shown is None else type(shown.texture).__name__,
            rotation=[] if shown is None else shown.pose.rotation.tolist(),
            translation_mm=[] if shown is None else shown.pose.translation_mm.tolist(),
            deformation_gradient=[] if shown is None else shown.deformation_gradient.tolist(),
            load_n=0.0 if shown is None else shown.load_n,
            displacement_mm=0.0 if shown is None else shown.displacement_mm,
            band=None if shown is None or shown.band is None else asdict(shown.band),
        )

    def write(self, what: str, **values: Any) -> None:
        """Write one line to the log. After `close`, this method does nothing."""
        now_s, now = self._clock.now_s(), self._clock.utc()
        # Write the time of the event itself, because the event may be reported late.
        happened = now - timedelta(seconds=now_s - values.get("time_s", now_s))
        line = {"what": what, "utc": happened.isoformat(), "time_s": now_s, **values}
        with self._lock:
            if self._file is not None:
                self._file.write(json.dumps(line) + "\n")

    def close(self) -> None:
        """Write the commands since the last sample and close the file; a repeated call does nothing."""
        try:
            self.sample()
        finally:
            with self._lock:
                file, self._file = self._file, None
            if file is not None:
                file.close()
