"""Tests of the addresses of the simulation's servers: wanted, used by others, or malformed."""

import socket
import stat
import threading
from contextlib import closing

import pytest

from simulators.rig.places import SERVERS, ServerAddresses, served
from simulators.rig.simulation import Simulation


def test_servers_are_where_somebody_wants_them(tmp_path):
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    link = tmp_path / "stage"
    places = [f"load_frame={port}", f"stage={link}"]
    for _ in range(2):
        simulation = Simulation({}, "rig simulate", None, places)
        try:
            assert simulation.addresses["load_frame"] == f"127.0.0.1:{port}"
            assert simulation.addresses["stage"] == str(link)
            assert stat.S_ISCHR(link.stat().st_mode)
            assert f'port = "{link}"' in simulation.rig_file()
        finally:
            simulation.close()
        assert not link.is_symlink()


@pytest.mark.parametrize("kind", ["port", "scene", "link"])
def test_a_place_that_is_taken_is_refused_and_nothing_is_left_open(kind, tmp_path):
    before = set(threading.enumerate())
    taken = tmp_path / "stage"
    taken.write_text("somebody's")
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = other.getsockname()[1]
        place = {"port": f"load_frame={port}", "scene": f"scene={port}", "link": f"stage={taken}"}[kind]
        with pytest.raises(OSError, match=r"in use|exists"):
            Simulation({}, "rig simulate", None, [place])
    assert set(threading.enumerate()) <= before
    assert taken.read_text() == "somebody's"


def test_a_name_is_not_taken_from_a_simulation_that_runs(tmp_path):
    place = f"stage={tmp_path / 'stage'}"
    simulation = Simulation({}, "rig simulate", None, [place])
    try:
        simulation.switch_on("stage.unplug")
        with pytest.raises(FileExistsError):
            Simulation({}, "rig simulate", None, [place])
    finally:
        simulation.close()
    # what a killed one leaves behind points into a folder that was swept away
    (tmp_path / "stage").symlink_to(tmp_path / "offaxis-pty-1-gone" / "tty")
    Simulation({}, "rig simulate", None, [place]).close()


def test_somebodys_link_is_left_alone_wherever_it_points(tmp_path):
    link = tmp_path / "stage"
    link.symlink_to(tmp_path / "unmounted" / "tty")
    with pytest.raises(FileExistsError):
        Simulation({}, "rig simulate", None, [f"stage={link}"])
    assert link.is_symlink()


@pytest.mark.parametrize(
    "place",
    [
        "",
        "load_frame",
        "load_frame=0",
        "load_frame=65536",
        "load_frame=/tmp/x",
        "stage=",
        "camera=5000",
        "scene=²",
    ],
)
def test_a_place_that_is_none_is_refused(place):
    with pytest.raises(ValueError, match="instead of NAME=PORT"):
        Simulation({}, "rig simulate", None, [place])


def test_one_server_has_one_place():
    with pytest.raises(ValueError, match="a second place for scene"):
        ServerAddresses.read(["scene=5000", "scene=5001"])


BESIDE_A_CLOSED_MACHINE = {"simulation": {"driver": "virtual-rig", "closed_machine": {}}}


def test_places_are_for_all_servers_there_are(simulation):
    with closing(Simulation(BESIDE_A_CLOSED_MACHINE)) as other:
        assert sorted({*simulation.addresses, *other.addresses}) == sorted(SERVERS)
        assert sorted(other.addresses) == sorted(served(closed_machine=True))
    assert sorted(simulation.addresses) == sorted(served(closed_machine=False))


@pytest.mark.parametrize(
    ("tables", "name"), [({}, "closed_machine"), (BESIDE_A_CLOSED_MACHINE, "load_frame")]
)
def test_a_place_for_a_server_that_is_not_there_is_refused(tables, name):
    with pytest.raises(ValueError, match=f"a place for {name}, which this simulation does not have"):
        Simulation(tables, "rig simulate", None, [f"{name}=5020"])
