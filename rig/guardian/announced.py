"""Devices that report to the guardian before each motion, and before a person is asked."""

from collections.abc import Callable
from dataclasses import replace
from functools import wraps
from typing import Any, cast

from drivers.interfaces import LoadFrame, Operator, RotationStage
from rig.devices import Rig
from rig.guardian.guardian import Guardian

LOAD_FRAME_MOTIONS = ("go_to_load", "go_to_displacement", "tare")
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
