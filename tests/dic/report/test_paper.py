"""The report shows the quantities of the paper beside those of the runs."""

from tests.dic.report.page import Page
from tests.dic.report.runs import STRAIGHT


def test_tension_is_set_beside_what_the_paper_reported(tension_html: str) -> None:
    rows = {row[-2] + " " + row[0]: row[-1] for row in Page(tension_html).table("comparison")[1:]}
    bias = next(v for k, v in rows.items() if "difference of the calibrated off-axis camera" in k)
    change = next(v for k, v in rows.items() if "what calibration changes" in k)
    others = next(v for k, v in rows.items() if "difference of the other strains" in k)
    assert bias == "εyy −1000 µε"
    assert change == "εxx 0 µε, εyy 0 µε, εxy 0 µε"
    assert others == "εxx 0 µε, εxy 0 µε"


def test_corrected_tension_is_set_beside_the_paper_too(corrected_html: str) -> None:
    rows = {row[0]: row[-2:] for row in Page(corrected_html).table("comparison")[1:]}
    along = next(v for k, v in rows.items() if "difference of the corrected off-axis camera" in k)
    others = next(v for k, v in rows.items() if "the other strains, corrected" in k)
    together = next(v for k, v in rows.items() if "both cameras together" in k)
    assert along == ["run 1, off_axis 30.0°", "εyy 2 µε (3 of 4 steps)"]
    assert others == ["run 1, off_axis 30.0°", "εxx 0 µε, εxy 0 µε (3 of 4 steps)"]
    assert together[1] == "εxx 0 µε, εyy 0 µε, εxy 0 µε"


def test_corrected_rotation_is_set_beside_the_paper_and_says_what_was_not_corrected(
    rotation_html: str,
) -> None:
    page = Page(rotation_html)
    rows = page.table("comparison")
    worst = rows.index(next(row for row in rows if "largest strain error after correction" in row[0]))
    assert rows[worst][-2:] == ["run 2, off_axis 30.0°", "εyy 7.0 ± 3.0 µε at 180.0°"]
    assert rows[worst + 1] == ["run 1, off_axis 10.0°", "not corrected"]
    assert f"run 2, on_axis: {STRAIGHT}." in page.text
    assert page.values("alt").count("Corrected mean strains against the angle of rotation") == 1


def test_rotation_runs_are_compared_from_the_largest_angle_down(rotation_html: str) -> None:
    rows = Page(rotation_html).table("comparison")
    worst = rows.index(next(row for row in rows if "largest strain error after" in row[0]))
    assert rows[worst][-2:] == ["run 2, off_axis 30.0°", "εxx 4000 µε at 180.0°"]
    assert rows[worst + 1] == ["run 1, off_axis 10.0°", "εxx 1200 µε at 180.0°"]


def test_captions_say_what_the_paper_says_and_what_is_here(rotation_html: str) -> None:
    captions = [" ".join(caption.split()) for caption in Page(rotation_html).captions]
    caption = next(c for c in captions if c.startswith("Calibrated mean strain"))
    assert "The paper: 4000 µε at 30°" in caption
    assert "Here: εxx 4000 µε at 180.0° (run 2, off_axis 30.0°); εxx 1200 µε at 180.0°" in caption
