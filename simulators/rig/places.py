"""Addresses of a virtual rig's servers: free ones, or fixed ones given by the user."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from simulators.wire.ports import PREFIX

TERMINALS = ("stage", "newport", "load_frame_rtu")
PORTS = ("stage_tcp", "load_frame", "load_frame_rtu_tcp", "scene")
SERVERS = (*TERMINALS, *PORTS)


@dataclass(frozen=True)
class Places:
    """The addresses given by the user; all other servers take any free address.

    Attributes
    ----------
    ports : mapping of str to int
        TCP ports of this machine, by the servers' names.
    links : mapping of str to Path
        Names for pseudo-terminals.
    """

    ports: Mapping[str, int] = field(default_factory=dict)
    links: Mapping[str, Path] = field(default_factory=dict)

    @classmethod
    def read(cls, texts: Iterable[str]) -> "Places":
        """Read ``NAME=PORT`` and ``NAME=PATH``; raise ValueError with the mistake."""
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
    """A fixed name (symbolic link) for a pseudo-terminal.

    Parameters
    ----------
    path : Path
    terminal : Path
        The pseudo-terminal's own path.

    Raises
    ------
    OSError
        If the name is taken, unless by a link that a killed simulation left behind.
    """

    def __init__(self, path: Path, terminal: Path) -> None:
        self._path, self._terminal = path, terminal
        # the folder exists while the simulation runs, the terminal only while it is plugged in
        if path.is_symlink():
            folder = path.readlink().parent
            if folder.name.startswith(PREFIX) and not folder.exists():
                path.unlink()
        path.symlink_to(terminal)

    def close(self) -> None:
        """Remove the link; harmless when repeated."""
        if self._path.is_symlink() and self._path.readlink() == self._terminal:
            self._path.unlink()
