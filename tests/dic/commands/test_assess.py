from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dic.assessment import assessment, models, paper, plots
from tests.command_line import run_dic


@pytest.mark.extended
def test_assess_with_few_cameras_finds_where_the_claim_fails(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    ends = tuple(replace(sweep, values=(sweep.values[0], sweep.values[-1])) for sweep in paper.SWEEPS)
    for module in (paper, assessment, plots):
        monkeypatch.setattr(module, "SWEEPS", ends)
    monkeypatch.setattr(models, "_REPETITIONS", 1)
    # Putting figures together is tested here, and drawing them below.
    monkeypatch.setattr(plots, "write_figure", lambda figure, path, **_: path.touch())
    done = run_dic("assess", "-o", tmp_path / "out", "--json", tmp_path / "assess.json")
    assert done.status == 0
    rows = done.report["rows"]
    found = {(r["sweep"], r["value"], r["grid"]): r for r in rows}
    # the paper's figures
    assert found["pan", 30, "base"]["maximum_px"] == pytest.approx(1.49e-2, abs=0.005e-2)
    assert found["pan", 30, "oversized"]["maximum_px"] == pytest.approx(0.234, abs=0.0005)
    assert found["pan", 30, "base"]["figure"] == 2
    assert found["pan", 0, "base"]["maximum_px"] < 1e-9
    assert done.out.count("does not hold beyond") == 3
    assert done.out.count("holds throughout") == 1
    exact, noisy = (
        [row[kind]["pinhole"] for row in done.report["models"]] for kind in ("exact_px", "noisy_px")
    )
    # exact points of a pinhole leave nothing to a pinhole; noise leaves it 12 of its 882 degrees of freedom.
    # Of one repetition, chi-square with 12 degrees of freedom is below 1.5² times its mean in 99 % of cases.
    assert max(exact) < 1e-6
    assert max(noisy) < 0.01 * np.sqrt(2 * 12 / 882) * 1.5
    assert done.report["models"][-1]["exact_px"]["bicubic"] > 0.02
    figures = [f"figure_{number:02d}.png" for number in range(2, 15)]
    assert sorted(path.name for path in (tmp_path / "out").glob("*.png")) == [*figures, "overview.png"]
    assert len((tmp_path / "out" / "assessment.csv").read_text().splitlines()) == len(rows) + 1 == 25


@pytest.mark.extended
def test_assess_prints_the_paper_s_numbers_and_where_its_claim_fails(tmp_path: Path) -> None:
    done = run_dic("assess", "-o", tmp_path / "out", "--json", tmp_path / "assess.json")
    assert done.status == 0
    printed = done.out
    rows = done.report["rows"]
    base = next(r for r in rows if (r["sweep"], r["value"], r["grid"]) == ("pan", 30, "base"))
    assert base["maximum_px"] == pytest.approx(1.49e-2, abs=0.005e-2)
    assert base["figure"] == 2
    assert printed.count("does not hold") == 3
    assert "holds throughout" in printed
    models = done.report["models"]
    # exact points of a pinhole leave nothing to a pinhole; noise leaves it 12 of its 882 degrees of freedom
    assert all(row["exact_px"]["pinhole"] < 1e-6 for row in models)
    assert all(row["noisy_px"]["pinhole"] < 0.01 * np.sqrt(2 * 12 / 882) * 1.3 for row in models)
    assert models[-1]["exact_px"]["bicubic"] > 0.02
    assert f"{models[-1]['noisy_px']['bicubic']:.2e}" in printed
    figures = [f"figure_{number:02d}.png" for number in range(2, 15)]
    assert sorted(path.name for path in (tmp_path / "out").glob("*.png")) == [*figures, "overview.png"]
    assert len((tmp_path / "out" / "assessment.csv").read_text().splitlines()) == len(rows) + 1
