"""The report as a PDF file: real and simulated runs are told apart on every page."""

import pytest

from dic.report import write_report
from tests.dic.report.runs import corrected_rotation_run, rotation_run
from tests.pdf_files import page_texts, require_pango


@pytest.mark.long
def test_simulated_is_written_on_every_page_of_a_simulated_run_only(tmp_path):
    require_pango()
    real, simulated = rotation_run(10.0, 0.0012), corrected_rotation_run(30.0, 0.004, simulated=True)
    for name, runs in {"both": [real, simulated], "one": [simulated], "real": [real]}.items():
        write_report(runs, tmp_path / f"{name}.html", pdf=tmp_path / f"{name}.pdf")
    assert all("SIMULATED" in page for page in page_texts(tmp_path / "one.pdf"))
    assert not any("SIMULATED" in page for page in page_texts(tmp_path / "real.pdf"))
    both = page_texts(tmp_path / "both.pdf")
    first = next(
        k
        for k, page in enumerate(both)
        if page.startswith("Run 1:") or "Run 1: A rotation test sheet" in page
    )
    second = next(k for k, page in enumerate(both) if "Run 2: A rotation test sheet" in page)
    assert first < second
    assert not any("SIMULATED" in page for page in both[first:second])
    assert all("SIMULATED" in page for page in both[second:])
