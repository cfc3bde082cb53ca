"""Addresses of a virtual rig's servers: free addresses, or fixed addresses given by the user."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from simulators.wire.ports import PREFIX

TERMINALS = ("stage", "newport", "load_frame_rtu")
PORTS = ("stage_tcp", "load_frame", "load_frame_rtu_tcp", "interlocks", "closed_machine", "scene")
SERVERS = (*TERMINALS, *PORTS)
_OF_LOAD_FRAME = ("load_frame", "load_frame_rtu", "load_frame_rtu_tcp")


def served(*, closed_machine: bool) -> tuple[str, ...]:
    """Return the names of the servers of a rig with a closed machine, or with a load frame instead."""
    absent = _OF_LOAD_FRAME if closed_machine else ("closed_machine",)
    return tuple(name for name in SERVERS if name not in absent)


@dataclass(frozen=True)
class ServerAddresses:
    """The addresses that the user gives. Servers without a given address take any free address."""

    # TCP ports on this machine, by the names of the servers
    ports: Mapping[str, int] = field(default_factory=dict)
    # paths of links to pseudo-terminals, by the names of the servers
    links: Mapping[str, Path] = field(default_factory=dict)

    @classmethod
    def read(cls, texts: Iterable[str]) -> "ServerAddresses":
        """Read texts of the form ``NAME=PORT`` or ``NAME=PATH``; raise `ValueError` for a malformed text."""
        ports: dict[str, int] = {}
        links: dict[str, Path] = {}
        for text in texts:
            name, _, place = text.partition("=")
            if name in (*ports, *links):
                raise ValueError(f"a second place for {name}, {place!r}")
            if name in PORTS and place.isascii() and place.isdecimal() and 0 < int(place[:6]) < 2**16:
                ports[name] = int(place)
            elif name in TERMINALS and place:
                links[name] = Path(place).absolute()
            else:
                raise ValueError(
                    f"{text!r} instead of NAME=PORT with one of {', '.join(PORTS)}, "
                    f"or NAME=PATH with one of {', '.join(TERMINALS)}"
                )
        return cls(ports, links)


class Link:
    """A symbolic link that gives a pseudo-terminal a fixed path.

    `path` is the path of the link. `terminal` is the path of the pseudo-terminal. Raise `OSError` if the path
    exists already. A link that a killed simulation left behind is replaced instead.
    """

    def __init__(self, path: Path, terminal: Path) -> None:
        self._path, self._terminal = path, terminal
        # Check the folder, not the terminal: the folder exists as long as the simulation runs, but the
        # terminal is missing while it is unplugged.
        if path.is_symlink():
            folder = path.readlink().parent
            if folder.name.startswith(PREFIX) and not folder.exists():
                path.unlink()
        path.symlink_to(terminal)

    def close(self) -> None:
        """Remove the link; a repeated call does nothing."""
        if self._path.is_symlink() and self._path.readlink() == self._terminal:
            self._path.unlink()
