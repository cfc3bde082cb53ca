"""Check that the rig has the devices that a protocol moves."""

from rig.devices import Rig
from rig.errors import ProtocolError
from rig.protocol.protocol import Protocol


def require_devices(protocol: Protocol, rig: Rig) -> None:
    """Raise `ProtocolError` if the rig lacks a device that the protocol moves."""
    for needed in sorted(protocol.conditions.devices):
        if getattr(rig, needed) is None:
            raise ProtocolError(
                f"a {protocol.kind} protocol",
                f"a [{needed}] in the rig file",
                "none",
                f"add a [{needed}], or run the protocol on a rig that has one",
            )
