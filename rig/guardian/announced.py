"""Devices that report to the guardian before each motion, and before a person is asked."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import wraps
from pathlib import Path
from typing import Any, cast

from drivers.interfaces import LoadFrame, Operator, RotationStage
from rig.devices import Rig, open_rig
from rig.guardian.guardian import Guardian, guarded
from rig.guardian.lock import machines_locked
from rig.rigfile import RigFile

LOAD_FRAME_MOTIONS = ("go_to_load", "go_to_displacement", "change_speed", "tare")
STAGE_MOTIONS = ("home", "move_to")


class _Announced:
    """A wrapper around a device.

    Before each call of a method in `methods`, such as `move_to`, the wrapper calls the function `report`. All
    other methods are passed on to the device without a report.
    """

    def __init__(self, device: object, methods: tuple[str, ...], report: Callable[[], None]) -> None:
        self._device = device
        self._methods = methods
        self._report = report

    def __getattr__(self, name: str) -> Any:
        attribute = getattr(self._device, name)
        if name not in self._methods:
            return attribute

        @wraps(attribute)
        def reported(*arguments: Any, **named: Any) -> Any:
            self._report()
            return attribute(*arguments, **named)

        return reported


@contextmanager
def guarded_rig(rig_file: RigFile, log: Path) -> Iterator[tuple[Rig, Guardian]]:
    """Lock the machines of a rig file, start their guardian, and open all devices. Close all at the end.

    The guardian writes into the file `log` what it has done.
    """
    with (
        machines_locked(rig_file) as locks,
        guarded(rig_file, locks, log) as guardian,
        open_rig(rig_file, guardian.relays) as opened,
    ):
        yield announce(opened, guardian), guardian


def announce(rig: Rig, guardian: Guardian) -> Rig:
    """Return the rig with devices that tell the guardian about each motion or question before it begins."""
    load_frame, stage = rig.load_frame, rig.stage
    return replace(
        rig,
        load_frame=None
        if load_frame is None
        else cast(LoadFrame, _Announced(load_frame, LOAD_FRAME_MOTIONS, guardian.about_to_move)),
        stage=None
        if stage is None
        else cast(RotationStage, _Announced(stage, STAGE_MOTIONS, guardian.about_to_move)),
        operator=cast(Operator, _Announced(rig.operator, ("perform",), guardian.waiting_for_a_person)),
    )
