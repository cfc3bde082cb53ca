"""Addresses in a rig file: as written, or by name from the simulated rig."""

from drivers.errors import LinkLost
from drivers.interfaces import OpenContext


def resolve_address(address: str, context: OpenContext) -> str:
    """Return the address to open; ``@name`` is looked up among the servers of the simulated rig.

    Raises
    ------
    LinkLost
        If there is no simulated rig, or it has no server of that name.
    """
    if not address.startswith("@"):
        return address
    known = {} if context.environment is None else dict(context.environment.addresses)
    if address[1:] not in known:
        raise LinkLost(
            f"{context.name} ({address})",
            "resolve address",
            f"a simulated rig with a server {address[1:]!r}",
            "servers " + ", ".join(sorted(known)) if known else "no simulated rig",
            "add a [simulation] table to the rig file, or write the real address",
        )
    return str(known[address[1:]])
