"""`dic target` draws a target and prints the options by which `dic calibrate` finds it."""

from pathlib import Path

import pytest

import dic
from dic.commands.calibrate import calibrate
from dic.commands.target_options import TargetOptions
from tests.command_line import refusal, run_dic

KINDS = {"lines": "11x9", "checkerboard": "10x7", "charuco": "7x5", "dots": "12x9", "asymmetric-dots": "5x11"}


@pytest.mark.parametrize(
    "kind", [pytest.param(kind, marks=() if kind == "charuco" else pytest.mark.extended) for kind in KINDS]
)
def test_the_printed_options_find_the_target(kind: str, tmp_path: Path) -> None:
    sheet = tmp_path / "target.png"
    done = run_dic("target", kind, "--count", KINDS[kind], "--pitch-mm", 10, "-o", sheet, "--dpi", 100)
    assert done.status == 0
    options = done.out.split("dic calibrate IMAGE ")[1].split()
    assert run_dic("calibrate", sheet, *options).status == 0


@pytest.mark.parametrize("name", dic.targets.TARGETS)
def test_the_options_of_a_target_describe_this_target(name: str) -> None:
    values = {"pitch_mm": 2.5, "marker_mm": None, "dictionary": "DICT_4X4_100"}
    target = dic.targets.TARGETS[name].of((12, 11), values)
    given = calibrate.make_context("calibrate", ["image.png", *target.options.split()]).params
    options = {name.removeprefix("target_"): given[name] for name in given if name.startswith("target_")}

    assert TargetOptions(**options).read() == target


@pytest.mark.parametrize("command", ["target", "gauges", "export"])
def test_the_help_names_every_kind_of_the_registry(command: str) -> None:
    registry = {"target": dic.targets.TARGETS, "gauges": dic.gauges.GAUGES, "export": dic.exports.EXPORTS}[
        command
    ]
    text = run_dic(command, "--help").out

    assert [name for name in registry if name not in text] == []


def test_an_impossible_target_is_refused(tmp_path: Path) -> None:
    sheet = tmp_path / "target.pdf"

    assert "at least 5 along X" in refusal("target", "dots", "--count", "3x9", "--pitch-mm", 5, "-o", sheet)
    assert "at least 4 lines" in refusal("target", "lines", "--count", "2x2", "--pitch-mm", 5, "-o", sheet)
    assert "at least 4 lines" in refusal("target", "lines", "--count", "0x0", "--pitch-mm", 5, "-o", sheet)
    args = ["--count", "9x9", "--pitch-mm", 5, "--marker-mm", 3, "-o", sheet]
    assert "--marker-mm: expected a target of the KIND charuco, got dots" in refusal("target", "dots", *args)
    large = refusal("target", "dots", "--count", "70x70", "--pitch-mm", 50, "-o", sheet)
    assert "at most 2000 mm, got 3500 mm" in large
    assert not sheet.exists()
