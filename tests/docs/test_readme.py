"""The commands and the Python code in README.md are executed."""

import json
import re
from pathlib import Path

import pytest

from tests.command_line import run_dic, run_rig
from tests.docs.pages import commands
from tests.places import ROOT

README = ROOT / "README.md"
FROM_IMAGES, FROM_A_RUN = re.findall(
    r"^```python\n(.*?)^```", README.read_text("utf-8"), re.MULTILINE | re.DOTALL
)
SHOWN = commands(README)


pytestmark = [pytest.mark.extended, pytest.mark.usefixtures("beside_the_examples")]


def run(*words):
    done = {"dic": run_dic, "rig": run_rig}[words[0]](*words[1:])
    assert done.status == 0, done
    return done


def shown(*beginning):
    """Return the words of the only command in README.md with the given first words."""
    (found,) = [words for words in SHOWN if words[: len(beginning)] == list(beginning)]
    return found


def expanded(word):
    """Return the files that a word with a wildcard matches, as in a shell; or the word itself."""
    return sorted(map(str, Path().glob(word))) if "*" in word else [word]


def lines(code):
    return [line for line in code.splitlines() if line.strip()]


def test_first_images(tmp_path, capsys):
    for command in ("example", "calibrate", "correlate"):
        words = next(words for words in SHOWN if words[:2] == ["dic", command])
        run(*(part for word in words for part in expanded(word)))
    assert {path.name for path in (tmp_path / "maps").iterdir()} == {f"step-{k:02}.png" for k in range(1, 17)}
    assert len(lines(FROM_IMAGES)) <= 6
    scope = {}
    exec(compile(FROM_IMAGES, str(README), "exec"), scope)
    assert capsys.readouterr().out.startswith("mean eyy 0.002")
    truth = json.loads((tmp_path / "first" / "truth.json").read_text())["images"][7]
    # nothing has moved the specimen towards the camera, so the error is far below the shift's part of the std
    assert scope["image"].mean.eyy == pytest.approx(truth["eyy"], abs=40e-6)
    assert scope["image"].mean.exx == pytest.approx(truth["exx"], abs=40e-6)
    assert abs(scope["image"].measurement.mean.eyy - truth["eyy"]) > 400e-6
    assert (tmp_path / "map.png").stat().st_size > 10_000


def test_images_and_a_machines_table_become_a_test_report(tmp_path):
    for command in ("example", "calibrate"):
        run(*next(words for words in SHOWN if words[:2] == ["dic", command]))
    second = next(words for words in SHOWN if "--shift-std-um" in words)
    for words in (second, shown("dic", "report")):
        run(*(part for word in words for part in expanded(word)))
    (test,) = json.loads((tmp_path / "report.json").read_text())["tests"]
    uncorrected, corrected = (column["values"] for column in test["columns"])
    for name, truth in test["known"].items():
        value = corrected[name]
        # A shift of 1 µm at 40 mm is 25 µε in both directions. That is 1 % of the largest strain and of E.
        # It changes nu by 0.01 (1 + nu), which is 4 % of nu.
        most = 0.1 if name == "nu" else 0.03
        assert abs(value["value"] - truth) < 2.0 * value["std"] < most * truth, name
    assert abs(corrected["E_gpa"]["value"] / 73.1 - 1) < 0.01
    assert uncorrected["E_gpa"]["value"] / 73.1 < 0.9


@pytest.mark.long
def test_your_rig(tmp_path, capsys):
    plan = run(*shown("rig", "plan"))
    assert "reference" in plan.out
    run(*shown("rig", "check"))
    # The shortest example instead of README's tension test, which takes half a minute to be measured.
    rig_file = "examples/rig-virtual-rotation-30.toml"
    run(
        "rig",
        "run",
        "examples/half-turn.toml",
        "--rig",
        rig_file,
        "-o",
        shown("rig", "run", "examples/tension.toml")[-1],
    )
    run(*shown("rig", "verify"))
    assert len(lines(FROM_A_RUN)) <= 6
    scope = {}
    exec(compile(FROM_A_RUN, str(README), "exec"), scope)
    assert "corrected: mean eyy" in capsys.readouterr().out
    # A turned specimen is not strained; seen off-axis, half a turn about a leaning axis adds 4000 µε of exx.
    last = scope["last"]
    assert abs(last.measurement.mean.exx) > 3500e-6
    assert max(abs(last.mean.exx), abs(last.mean.eyy)) < 20e-6
    assert (tmp_path / "last-step.png").stat().st_size > 10_000


@pytest.mark.long
def test_beside_a_closed_machine(tmp_path):
    """The three commands give E and its standard deviation, beside the value that the page states."""
    commands_shown = [
        words for words in SHOWN if any("beside." in word for word in words) and words[0] in ("rig", "dic")
    ]
    assert [words[1] for words in commands_shown] == ["run", "process", "properties"]
    *first, last = commands_shown
    for words in first:
        run(*words)
    run(*last, "--json", tmp_path / "properties.json")
    found = json.loads((tmp_path / "properties.json").read_text())["E_gpa"]
    assert abs(found["value"] - 73.1) < 3.0 * found["std"] < 3.0
    assert "E is 73.0 ± 0.6 GPa" in README.read_text("utf-8")
