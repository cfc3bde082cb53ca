"""A second measurement correlates only the images for which something has changed."""

import hashlib
import shutil

import h5py
import numpy as np
import pytest
from PIL import Image

import dic.pipeline.reuse as lookup
import dic.pipeline.series_image as module
from tests.command_line import refusal, run_dic
from tests.dic.pipeline.rendered_run import SMALL, slid, write_rendered_run
from tests.dic.result_values import bits, results
from tests.image_files import write_image

pytestmark = pytest.mark.usefixtures("grids_found_once")


@pytest.fixture
def images(speckle, tmp_path):
    """A reference and two images; the second shows nothing, so it cannot be correlated."""
    folder = tmp_path / "images"
    folder.mkdir()
    pattern = speckle(seed=21, shape=(160, 160))
    write_image(folder / "img0.png", pattern.draw())
    write_image(folder / "img1.png", pattern.draw(lambda x, y: (x - 0.37, y)))
    write_image(folder / "img2.png", np.full((160, 160), 128.0))
    return folder


def command(images, *options):
    return ("correlate", images, "--subset", 21, "--step", 20, *options)


def test_equal_series_is_read_and_printed_again(images, tmp_path, correlated):
    result = tmp_path / "r.h5"
    first = run_dic(*command(images, "-o", result))
    before, correlated[:] = result.stat().st_mtime_ns, []
    again = run_dic(*command(images, "-o", result, "--csv", tmp_path / "csv", "--json", tmp_path / "r.json"))
    assert correlated == []
    assert (again.status, again.err) == (first.status, first.err)
    (said,) = set(again.out.splitlines()) - set(first.out.splitlines())
    assert said == f"{result}: holds these results already: equal input, settings and versions;" + (
        " nothing is correlated"
    )
    assert result.stat().st_mtime_ns == before
    assert (tmp_path / "csv" / "strain.csv").read_text().count("\n") == 3
    assert len(again.report["images"]) == len(again.report["failures"]) == 1


def test_changed_strain_alone_is_computed_again(images, tmp_path, correlated):
    result, whole, other = (tmp_path / f"{name}.h5" for name in ("r", "whole", "other"))
    assert run_dic(*command(images, "-o", result)).status == 2
    assert run_dic(*command(images, "--strain-window", 5, "-o", whole)).status == 2
    correlated.clear()
    changed = command(images, "--strain-window", 5)
    assert "one that exists; name another place, or replace it with --force" in refusal(
        *changed, "-o", result
    )
    assert run_dic(*changed, "-o", other, "--fields-from", result).status == 2
    done = run_dic(*changed, "-o", result, "--force")
    assert f"{result}: its displacement fields are used again; nothing is correlated" in done.out
    assert correlated == []
    assert results(result) == results(other) == results(whole)


def test_fields_of_another_measurement_are_refused_or_left(images, tmp_path, correlated):
    result = tmp_path / "r.h5"
    assert run_dic(*command(images, "-o", result)).status == 2
    other = command(images, "--min-zncc", 0.7, "--fields-from", result, "-o", tmp_path / "n.h5")
    assert "got one with other min_zncc; leave out --fields-from" in refusal(*other)
    write_image(images / "img2.png", 255 - run_image(images / "img1.png"))
    assert "got one with other images" in refusal(
        *command(images, "--fields-from", result, "-o", tmp_path / "n.h5")
    )
    correlated.clear()
    assert run_dic(*command(images, "-o", result, "--force")).status == 2
    assert len(correlated) == 2


def test_a_result_of_another_measurement_is_not_read_whole_to_be_replaced(images, tmp_path, monkeypatch):
    result = tmp_path / "r.h5"
    assert run_dic(*command(images, "-o", result)).status == 2
    read, load = [], lookup.load_fields
    monkeypatch.setattr(lookup, "load_fields", lambda path: read.append(path) or load(path))
    assert run_dic(*command(images, "--min-zncc", 0.7, "-o", result, "--force")).status == 2
    assert read == []
    assert run_dic(*command(images, "--min-zncc", 0.7, "-o", result)).status == 2
    assert read == [result]


def run_image(path):
    from dic import read_image

    return read_image(path).astype("uint8")


def test_images_at_another_place_are_known_by_their_content(images, tmp_path, correlated):
    result, moved = tmp_path / "r.h5", tmp_path / "moved"
    (images / "img2.png").unlink()
    assert run_dic(*command(images, "-o", result)).status == 0
    shutil.copytree(images, moved)
    correlated.clear()
    assert "one that exists" in refusal(*command(moved, "-o", result))
    assert run_dic(*command(moved, "-o", result, "--force", "--json", tmp_path / "r.json")).status == 0
    assert correlated == []
    done = run_dic(*command(moved, "-o", result, "--force", "--json", tmp_path / "r.json"))
    assert [image["file"] for image in done.report["images"]] == [str(moved / "img1.png")]


def test_pages_of_one_file_are_not_taken_for_each_other(images, tmp_path, correlated):
    (images / "img2.png").unlink()
    write_image(images / "img3.png", np.roll(run_image(images / "img1.png"), 2, axis=1))
    first, *others = (Image.open(path) for path in sorted(images.glob("*.png")))
    stack, result = tmp_path / "stack.tif", tmp_path / "r.h5"
    first.save(stack, save_all=True, append_images=others)
    words = ("correlate", f"{stack}#1", f"{stack}#2", "--subset", 21, "--step", 20, "-o", result)
    assert run_dic(*words).status == 0
    correlated.clear()
    for reference, image in ((1, 3), (2, 3)):
        other = ("correlate", f"{stack}#{reference}", f"{stack}#{image}", *words[3:])
        assert run_dic(*other, "--force").status == 0
    assert len(correlated) == 2


def test_each_file_is_digested_once(images, tmp_path, monkeypatch):
    digested, digest = [], module.file_sha256
    monkeypatch.setattr(module, "file_sha256", lambda file, most: digested.append(file) or digest(file, most))
    assert run_dic(*command(images, "-o", tmp_path / "r.h5")).status == 2
    assert sorted(digested) == [images / f"img{k}.png" for k in range(3)]
    digested.clear()
    # The images of the file are compared first, and then correlated with another setting.
    assert run_dic(*command(images, "-o", tmp_path / "r.h5", "--min-zncc", 0.7, "--force")).status == 2
    assert sorted(digested) == [images / f"img{k}.png" for k in range(3)]
    digests, changed = module.FileDigests(), images / "img1.png"
    before = digests.of(changed)
    write_image(changed, 255 - run_image(changed))
    assert digests.of(changed) == hashlib.sha256(changed.read_bytes()).hexdigest() != before


def inputs_of(path):
    """Return the digests of the input files that a result file names."""
    with h5py.File(path) as file:
        names, digests = (file[f"provenance/{name}"].asstr()[:] for name in ("file", "sha256"))
    return dict(zip(names, digests, strict=True))


def test_equal_run_is_read_and_changed_strain_is_computed(tmp_path, correlated):
    run = write_rendered_run(tmp_path / "run.h5", [slid(0.05)], camera=SMALL)
    result, whole = tmp_path / "run.results.h5", tmp_path / "whole.h5"
    settings = tmp_path / "settings.toml"
    settings.write_text("[correlation]\nstep_px = 30\n")
    used = {str(path): hashlib.sha256(path.read_bytes()).hexdigest() for path in (run, settings)}
    words, changed = ("process", run, "--settings", settings), ("--strain-window", 5, "--plate-mm", 0.5)
    first = run_dic(*words)
    assert run_dic(*words, *changed, "-o", whole).status == first.status == 0
    before, correlated[:] = bits(result), []
    again = run_dic(*words)
    assert "holds these results already" in again.out
    assert first.out.splitlines()[:4] == again.out.splitlines()[1:5]
    assert bits(result) == before
    assert "one that exists" in refusal(*words, *changed)
    assert inputs_of(result) == used
    assert run_dic(*words, *changed, "--force").status == 0
    assert correlated == []
    assert results(result) == results(whole)
    assert inputs_of(result).items() >= used.items()
    own = tmp_path / "strain.toml"
    own.write_text("[strain]\nwindow_points = 7\n")
    assert run_dic("strain", whole, "--settings", own, "-o", tmp_path / "anew.h5").status == 0
    assert inputs_of(tmp_path / "anew.h5").keys() == {*used, str(whole), str(own)}
