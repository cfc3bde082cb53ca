"""Addresses in a rig file: literal addresses, names of the simulated rig, lasting names of the system."""

from pathlib import Path

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


def lasting_names(folder: Path) -> dict[str, str]:
    """Return the links in a folder such as ``/dev/serial/by-id``, keyed by the name of their target."""
    if not folder.is_dir():
        return {}
    return {link.resolve().name: str(link) for link in sorted(folder.iterdir(), reverse=True)}
