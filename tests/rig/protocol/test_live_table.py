"""The table `[live]` of a protocol: its gauges and settings, and all mistakes in it together."""

import pickle
import re
import tomllib

import pytest

from drivers.errors import ConfigurationError
from rig.protocol.live_table import LiveTable
from rig.protocol.protocol import read_protocol, recorded_protocol
from tests.places import DOCS

BEFORE = """
kind = "acquire"
title = "t"
[acquire]
every_s = 0.1
[end]
duration_s = 1
[live]
"""
AXIAL = '"axial=extensometer unit=mm start=0,-3 end=0,3 patch=1"'


def read(tmp_path, table):
    path = tmp_path / "protocol.toml"
    path.write_text(BEFORE + table)
    return read_protocol(path)


def test_the_documentation_lists_every_key_and_its_example_is_a_table():
    section = (DOCS / "protocols.md").read_text().split("## Live gauges: `[live]`")[1].split("\n## ")[0]
    rows = section.split("| key of `[live]` |")[1].split("\n\n")[0]
    first_cells = re.findall(r"^\|([^|]*)\|", rows, re.MULTILINE)
    keys = [key for cell in first_cells for key in re.findall(r"`([a-z_]+)`", cell)]
    assert sorted(keys) == sorted(LiveTable.model_fields)
    (text,) = re.findall(r"```toml\n(.*?)```", section, re.DOTALL)
    assert LiveTable.model_validate(tomllib.loads(text)["live"]).names == ["axial"]


def test_gauges_come_from_texts_and_from_a_file_beside_the_protocol(tmp_path):
    (tmp_path / "gauges.toml").write_text(
        '[[gauge]]\nname = "area"\nkind = "area"\ncentre = [100, 100]\nsize = [50, 50]\n'
    )
    (tmp_path / "earlier.h5").touch()
    text = f'gauges = [{AXIAL}]\ngauges_file = "gauges.toml"\ngrid_from = "earlier.h5"\nsubset_px = 31\n'
    live = read(tmp_path, text + "most_strain_per_s = 0.2\nsmoothing_px = 0.5").live
    assert live.names == ["area", "axial"]
    assert live.grid_run == tmp_path / "earlier.h5"
    assert (live.correlation().subset_px, live.correlation().step_px) == (31, 10)
    assert live.correlation().smoothing_px == 0.5
    assert (live.live().most_strain_per_s, live.live().least_share) == (0.2, 0.8)
    assert pickle.loads(pickle.dumps(live)).declared == live.declared


def test_a_protocol_in_a_run_file_names_files_that_need_not_be_there(tmp_path):
    live = recorded_protocol(f'{BEFORE}gauges = [{AXIAL}]\ngauges_file = "gone.toml"', []).live
    assert live.names == ["axial"]


def test_without_the_table_nothing_is_live(tmp_path):
    path = tmp_path / "protocol.toml"
    path.write_text(BEFORE.replace("[live]\n", ""))
    assert read_protocol(path).live is None


def test_all_mistakes_are_named_together(tmp_path):
    table = """
gauges = ["a b=extensometer", "cut=cut start=0,0 end=9,9 width=5 places=3"]
gauges_file = "missing.toml"
grid_from = "missing.h5"
subset_px = 30
least_share = 0.2
motion = "rigid"
tpyo = 1
"""
    with pytest.raises(ConfigurationError) as refused:
        read(tmp_path, table)
    mistakes = refused.value.mistakes
    for words in (
        "live.gauges", "live.gauges_file", "live.grid_from: an earlier run file",
        "live.subset_px: an odd number, at least 7 px is expected",
        "live.least_share: from 0.5 to 1 is expected", "live.motion", "live.tpyo: unknown key",
    ):  # fmt: skip
        assert any(mistake.startswith(words) for mistake in mistakes), (words, mistakes)


@pytest.mark.parametrize(
    ("gauges", "words"),
    [
        ("[]", "at least one gauge is expected"),
        ('["far left=point at=1,1"]', "NAME=KIND"),
        ('["far-left=point at=1,1"]', "letters, digits and _ only"),
        ('["c=cut start=0,0 end=9,9"]', "a gauge with a strain is expected"),
        (f"[{AXIAL}, {AXIAL}]", "'axial' twice"),
    ],
)
def test_gauges_that_cannot_be_live_ones_are_refused(tmp_path, gauges, words):
    with pytest.raises(ConfigurationError, match=words):
        read(tmp_path, f"gauges = {gauges}")


def test_names_that_do_not_fit_the_rig_are_told(tmp_path):
    live = read(tmp_path, f'gauges = [{AXIAL}]\ncamera = "left"').live
    first, second = live.mistakes(["straight", "aside"], ["force", "axial"])
    assert "no signal of the rig has, got 'axial'" in first
    assert "a camera of the rig is expected (straight, aside), got 'left'" in second
    assert live.mistakes(["left"], ["force"]) == []
