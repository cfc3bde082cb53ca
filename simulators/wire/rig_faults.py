"""The faults of all devices of a virtual rig, with texts ``DEVICE.FAULT`` such as ``stage.drop:2``."""

from collections.abc import Iterator, Mapping

from simulators.wire.faults import FAULTS, FaultPanel


class RigFaults(Mapping[str, FaultPanel]):
    """The fault panels of a rig's devices, by the names of the devices.

    Parameters
    ----------
    panels : iterable of FaultPanel
    """

    def __init__(self, *panels: FaultPanel) -> None:
        self._panels = {panel.device: panel for panel in panels}

    def __getitem__(self, device: str) -> FaultPanel:
        return self._panels[device]

    def __iter__(self) -> Iterator[str]:
        return iter(self._panels)

    def __len__(self) -> int:
        return len(self._panels)

    def switch_on(self, text: str) -> None:
        """Switch on the fault with the text ``DEVICE.FAULT[:VALUE][:COUNT]``.

        Raises
        ------
        ValueError
            If the device or the fault does not exist, or the text is malformed.
        """
        device, dot, fault = text.strip().partition(".")
        self._panel(device, dot, text).switch_on(fault)

    def clear(self, text: str = "") -> None:
        """Switch off the fault ``DEVICE.FAULT``, or all faults of ``DEVICE``; an empty text means all faults.

        Raises
        ------
        ValueError
            If the device or the fault does not exist.
        """
        device, _, fault = text.strip().partition(".")
        if fault and fault not in FAULTS:
            raise ValueError(f"fault {fault!r}: expected one of {', '.join(FAULTS)}")
        panels = [self._panel(device, ".", text)] if device else list(self._panels.values())
        for panel in panels:
            panel.clear(fault)

    @property
    def active(self) -> list[str]:
        """The names ``DEVICE.FAULT`` of all faults that are on."""
        return [f"{name}.{fault}" for name, panel in self._panels.items() for fault in panel.active]

    def _panel(self, device: str, dot: str, text: str) -> FaultPanel:
        if device not in self._panels or not dot:
            raise ValueError(f"fault {text!r}: expected DEVICE.FAULT with one of {', '.join(self._panels)}")
        return self._panels[device]
