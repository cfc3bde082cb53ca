"""A run of many images in the report: thinned curves, a part of the rows, and maps of telling images."""

import numpy as np
import pytest

from dic.report.series import LONG, number_runs
from dic.report.tension import telling_images
from dic.report.thinning import MOST_DRAWN, some_of, thinned
from dic.runfile.reader import RunStep
from tests.dic.report.page import Page, number, written
from tests.dic.report.runs import INFO, camera, stretch, uncorrected

STEPS = LONG + 30
TOP = 71
"""Index of the step with the largest load."""


def long_run():
    """Return a run of one camera with an image every 0.5 s, asked for and kept but for the fourth."""
    steps = [
        RunStep(
            2 + k, "acquired", np.nan, 50.0 * (100 - abs(2 + k - TOP)), 0.01 * k, np.nan, 0.5 * k,
            due_s=0.5 * k, late_s=0.4 if k == 3 else 0.01,
        )
        for k in range(STEPS)
    ]  # fmt: skip
    measured = camera("on_axis", steps, [stretch(-3e-5 * k, 1e-4 * k) for k in range(STEPS)])
    measured.failures.extend(f"on_axis, step {k}: lost" for k in range(500, 600))
    return uncorrected("runs/long.h5", INFO, [measured])


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    return Page(written(tmp_path_factory.mktemp("long"), long_run(), drawn=False))


def test_table_has_the_ends_the_maximum_load_and_rows_between_them_with_their_own_values(page):
    rows = page.all_tables("steps")[0][2:]
    indices = [int(row[0]) for row in rows]
    assert len(rows) == 20
    assert {2, TOP, STEPS + 1} <= set(indices)
    for index, row in zip(indices, rows, strict=True):
        assert number(row[2]) == 50.0 * (100 - abs(index - TOP))
        assert number(row[6].replace(" ", "")) == pytest.approx(100.0 * (index - 2), abs=0.2)
    assert f"20 of {STEPS} steps; `dic process --csv FOLDER --json FILE` writes all of them." in page.text


def test_series_is_summarised_and_a_long_list_of_problems_is_cut(page):
    assert page.all_tables("series")[0][1] == ["on_axis", str(STEPS + 100), "2", "2", "1", "0", "100"]
    assert page.text.count(": lost") == 30
    assert "and 70 more such sentences" in page.text


def test_maps_are_those_of_the_telling_images(page):
    captions = [" ".join(each.split()) for each in page.captions]
    assert "on_axis at the first image, step 2." in captions
    assert f"on_axis at the maximum load, step {TOP}." in captions
    assert any(f"12 of {STEPS} images" in each for each in captions)
    (run,) = number_runs([long_run()])
    proof = run.steps[40]
    assert [step.index for step, _ in telling_images(run.steps, proof)] == [2, 42, TOP, STEPS + 1]
    assert telling_images(run.steps[:5])[-1][1] == "the maximum load and the last image"


def test_thinned_line_keeps_what_is_seen():
    rng = np.random.default_rng(2)
    x, y = np.linspace(0.0, 1.0, 20_000), rng.normal(size=20_000)
    y[7_000:7_100], y[11_111] = np.nan, 40.0
    drawn = thinned(x, y)
    assert len(drawn) <= MOST_DRAWN
    assert {0, 11_111, 19_999, int(np.nanargmin(y))} <= set(drawn.tolist())
    assert np.isnan(y[drawn]).any()
    assert (np.diff(drawn) > 0).all()
    assert len(thinned(x[:MOST_DRAWN])) == MOST_DRAWN


@pytest.mark.parametrize("count", [1, 19, 20, 21, 10_000])
def test_some_of_many_rows_are_the_wanted_ones_and_no_more(count):
    found = some_of(count, 20, [count // 3])
    assert len(found) == min(count, 20)
    assert {0, count // 3, count - 1} <= set(found)
    assert found == sorted(found)
