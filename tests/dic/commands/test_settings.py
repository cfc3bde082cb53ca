"""The settings file explains every default, refuses unknown keys, and gives the same results as options."""

import tomllib

import h5py
import pytest

import dic
from tests.command_line import refusal, run_dic
from tests.dic.result_values import results
from tests.image_files import write_image


@pytest.fixture(scope="module")
def images(speckle, tmp_path_factory):
    folder = tmp_path_factory.mktemp("images")
    pattern = speckle(seed=21, shape=(160, 160))
    for number in range(2):
        write_image(folder / f"img{number}.png", pattern.draw(lambda x, y, by=number: (x - 0.3 * by, y)))
    return folder


def test_settings_are_the_defaults_of_python_and_are_explained():
    text = run_dic("settings").out
    written = tomllib.loads(text)
    defaults = (dic.CorrelationSettings(), dic.StrainSettings(), dic.Motion())
    settings, strain, motion = map(vars, defaults)
    assert written["correlation"].pop("incremental") == "auto"
    assert written["correlation"].items() <= settings.items()
    assert written["strain"] == strain
    assert written["correction"] == {"motion": motion["kind"], "poisson_ratio": motion["poisson_ratio"]}
    lines = text.splitlines()
    keys = [k for k, line in enumerate(lines) if " = " in line]
    assert all(lines[k - 1].startswith("# ") for k in keys)
    # A key without a default can be taken from its comment.
    whole = tomllib.loads("\n".join(line.removeprefix("# ") if " = " in line else line for line in lines))
    assert set(whole["correction"]) > {"shift_std_um", "tilt_axis_mm", "plate_mm"}


def test_file_and_options_give_the_same_bits_and_options_win(images, tmp_path):
    file, by_file, by_options = (tmp_path / name for name in ("settings.toml", "file.h5", "options.h5"))
    file.write_text('[correlation]\nsubset_px = 31\nstep_px = 20\n\n[strain]\nmeasure = "hencky"\n')
    options = ("--subset", 21, "--step", 20, "--strain", "hencky")
    assert run_dic("correlate", images, *options, "-o", by_options).status == 0
    assert run_dic("correlate", images, "--settings", file, "--subset", 21, "-o", by_file).status == 0
    assert results(by_file) == results(by_options)
    with h5py.File(by_file) as made:
        assert "--subset 21" in made["provenance"].attrs["command"]
        assert str(file) in made["provenance/file"].asstr()[:]
    held = tmp_path / "held.toml"
    held.write_text(run_dic("settings", by_file).out)
    assert tomllib.loads(held.read_text())["correlation"]["subset_px"] == 21
    again = run_dic("correlate", images, "--settings", held, "-o", by_options)
    assert "holds these results already" in again.out


def test_file_of_all_defaults_serves_strain_anew(images, tmp_path):
    file, first, anew = (tmp_path / name for name in ("settings.toml", "first.h5", "anew.h5"))
    file.write_text(run_dic("settings").out + "plate_mm = 1.5\n")
    assert run_dic("correlate", images, "--subset", 21, "--strain-window", 5, "-o", first).status == 0
    assert run_dic("strain", first, "--settings", file, "-o", anew).status == 0
    assert dic.load_series_result(anew).series.images[0].measurement.strain_settings == dic.StrainSettings()


def test_all_mistakes_of_a_file_are_reported_together(images, tmp_path):
    file = tmp_path / "settings.toml"
    wrong = "[correlation]\nsubset = 21\nshape = 2\n[strane]\n[correction]\ntilt_axis_mm = '0'\n"
    file.write_text(f"step = 3\n{wrong}")
    said = refusal("correlate", images, "--settings", file)
    for part in (
        "[step]: expected one of the tables: correlation, strain, correction, got step",
        "correlation.subset: expected one of the keys of [correlation]: subset_px,",
        "did you mean subset_px",
        "correlation.shape: expected affine or quadratic, got 2",
        "[strane]: expected",
        "correction.tilt_axis_mm: expected X and Y of the grips' hinge in mm, at most 10000 mm away, got '0'",
    ):
        assert part in said
    assert "no such file" in refusal("process", "run.h5", "--settings", tmp_path / "none.toml")
    file.write_text("[correlation]\nsubset_px = 20\n")
    assert "correlation.subset_px: expected an odd number" in refusal("correlate", images, "--settings", file)
    file.write_text("[correlation")
    assert "a file that cannot be read (" in refusal("correlate", images, "--settings", file)
