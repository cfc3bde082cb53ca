"""Addresses in a rig file: real addresses, server names of a simulated rig, and permanent port names."""

import contextlib
import ipaddress
from pathlib import Path

from drivers.errors import LinkLost
from drivers.interfaces import OpenContext


def resolve_address(address: str, context: OpenContext) -> str:
    """Return the address to open. ``@name`` means the address of a server of the simulated rig.

    Raise `LinkLost` if there is no simulated rig, or the simulated rig has no server of that name.
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
    """Return the symbolic links in a folder such as ``/dev/serial/by-id``, keyed by their target's name."""
    if not folder.is_dir():
        return {}
    return {link.resolve().name: str(link) for link in sorted(folder.iterdir(), reverse=True)}


def shared_line(address: str) -> str:
    """Return the name of a line that only one program may use: the real path of a port, or ``host:port``.

    The name is empty for ``@name``, because this address is a server of the simulated rig inside this
    program. The name does not depend on the protocol: ``socket://localhost:4001`` and
    ``rtu://127.0.0.1:4001`` have the same name.
    """
    if address.startswith("@"):
        return ""
    if address.startswith("/"):
        return str(Path(address).resolve())
    host, _, port = address.rpartition("://")[2].rpartition(":")
    host = host.strip("[]").lower()
    with contextlib.suppress(ValueError):
        host = ipaddress.ip_address("127.0.0.1" if host == "localhost" else host).compressed
    return f"{host}:{port}"
