"""Tests of the output, the files and the refusals of the command `dic study`."""

import tomllib

import pytest

from benchmarks.speckle import Speckle, eight_bit
from tests.command_line import refusal, run_dic
from tests.image_files import write_image

SMALL = ("--subsets", "21,31", "--steps", "10", "--windows", "3", "--shapes", "affine")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    made, speckle = tmp_path_factory.mktemp("study"), Speckle(32, (240, 240))
    for number, name in enumerate(("reference", "rest")):
        write_image(made / f"{name}.png", eight_bit(speckle.draw(), 2.0, number))
    write_image(made / "other.png", eight_bit(Speckle(33, (200, 240)).draw(), 2.0, 3))
    return made


@pytest.mark.extended
def test_writes_settings_that_the_other_commands_take(folder, tmp_path):
    toml, picture = tmp_path / "settings.toml", tmp_path / "study.png"
    done = run_dic(
        *("study", folder / "reference.png", folder / "rest.png", *SMALL, "--period-px", 80),
        *("--json", tmp_path / "study.json", "--picture", picture, "--write", toml),
    )
    assert done.status == 0, done.err
    lines = done.out.splitlines()
    # lines with the path of a file are as long as the path
    without_paths = [line for line in lines if not any(str(place) in line for place in (folder, tmp_path))]
    assert max(map(len, without_paths)) <= 100
    assert lines[-2].startswith("  it has") or lines[-2].startswith("recommended:")
    report = done.report
    best = report["recommended"]
    assert (report["period_px"], report["strain_amplitude"], report["wave_from"]) == (80.0, 0.005, "given")
    assert report["noise_from"] == str(folder / "rest.png")
    assert best == report["settings"][0]
    assert best["strain_error"] == min(each["strain_error"] for each in report["settings"])
    for each in report["settings"]:
        squares = [each[f"{name}_{part}"] ** 2 for name in ("exx", "eyy") for part in ("noise", "bias")]
        assert each["strain_error"] ** 2 == pytest.approx(sum(squares) / 2)
    assert picture.stat().st_size > 10_000
    written = tomllib.loads(toml.read_text())
    assert written["correlation"]["subset_px"] == best["subset_px"]
    assert written["strain"]["window_points"] == 3
    again = run_dic("correlate", folder / "reference.png", folder / "rest.png", "--settings", toml)
    assert again.status == 0, again.err


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("nothing.png",), "nothing.png"),
        (("reference.png", "other.png"), "other.png: compare image sizes: expected 240 × 240 px like"),
        (("reference.png", "--subsets", "21;31"), "--subsets: expected whole numbers with commas between"),
        (("reference.png", "--subsets", "20"), "subset: expected an odd number"),
        (("reference.png", "--period-px", "nan"), "period of the assumed strain: expected 10 to 100000 px"),
        (("reference.png", "--parts", "0"), "parts: expected a whole number from 1 to 64"),
        (
            ("reference.png", "--subsets", "101", "--steps", "15", "--windows", "9"),
            "try the settings: expected a part that holds",
        ),
        (("reference.png", "--write", "reference.png"), "got one that is read"),
    ],
)
def test_refuses_in_one_sentence(folder, monkeypatch, arguments, words):
    monkeypatch.chdir(folder)
    assert words in refusal("study", *arguments)
