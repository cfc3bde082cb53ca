"""A series whose reference seems to be a deformed image is doubted; usual series are not."""

import os
from pathlib import Path

import pytest

from dic.pipeline.series_sources import doubts_about_order


@pytest.mark.parametrize(
    ("reference", "images", "why"),
    [
        ("step-08.png", ["reference.png"], "named as a reference"),
        ("load_3.tif", ["ref.tif", "load_4.tif"], "named as a reference"),
        ("step-16.png", ["step-08.png", "step-09.png"], "come before it by their names"),
        ("DSC_0000.png", ["DSC_0001.png", "DSC_9998.png", "DSC_9999.png"], "run over from the largest"),
        ("DSC_0000.png", ["DSC_0001.png", "DSC_0500.png", "DSC_0999.png"], ""),
        ("grid.png", ["step-1.png", "step-2.png"], "named as a calibration target"),
        ("reference.png", ["step-08.png"], ""),
        ("step-08.png", ["step-09.png", "step-07.png"], ""),
        ("ref-a.png", ["ref-b.png"], ""),
        ("preferred.png", ["sample.png"], ""),
        ("a.png", ["deformed.png"], ""),
    ],
)
def test_reference_is_doubted_by_its_name_or_its_number(tmp_path, reference, images, why):
    for name in (reference, *images):
        (tmp_path / name).write_bytes(b"")
    doubts = doubts_about_order(tmp_path / reference, [tmp_path / name for name in images])
    assert [why in doubt for doubt in doubts] == ([True] if why else [])


def test_times_of_copies_of_files_are_no_doubt(tmp_path):
    names = "a.png", "deformed.png"
    for k, name in enumerate(names):
        (tmp_path / name).write_bytes(b"")
        os.utime(tmp_path / name, (1e9 - k, 1e9 - k))
    assert doubts_about_order(*(Path(tmp_path / "a.png"), [tmp_path / "deformed.png"])) == []
