"""A killed `dic gauges` goes on with the readings that it has finished."""

import json

import pytest

from dic.derived import GaugeReader
from tests.command_line import run_dic
from tests.image_files import write_image

GAUGES = (
    *("--declare", "along=extensometer start=40,80 end=120,80 patch=20"),
    *("--declare", "part=area centre=80,80 size=60,60"),
    *("--declare", "line=cut start=40,80 end=120,80"),
)
IMAGES = 5


@pytest.fixture(scope="module")
def measured(speckle, tmp_path_factory):
    folder = tmp_path_factory.mktemp("series")
    pattern = speckle(seed=3, shape=(160, 160))
    files = [
        write_image(folder / f"{k}.png", pattern.draw(lambda x, y, k=k: (x / (1 + 0.001 * k), y)))
        for k in range(IMAGES + 1)
    ]
    result = folder / "r.h5"
    assert run_dic("correlate", *files, "--subset", 21, "--step", 10, "-o", result).status == 0
    return result


def test_readings_before_the_kill_are_not_read_again_and_the_files_have_the_same_bytes(
    measured, tmp_path, monkeypatch
):
    whole, again = ([tmp_path / f"{name}.csv", "--json", tmp_path / f"{name}.json"] for name in "ab")
    assert run_dic("gauges", measured, *GAUGES, "-o", *whole).status == 0
    read, count = GaugeReader.read, [0]

    def killed(self, image, **known):
        count[0] += 1
        if count[0] == 4:
            raise KeyboardInterrupt
        return read(self, image, **known)

    monkeypatch.setattr(GaugeReader, "read", killed)
    assert run_dic("gauges", measured, *GAUGES, "-o", *again).status != 0
    kept = tmp_path / ".b.csv.readings.partial"
    lines = kept.read_bytes().splitlines(keepends=True)
    assert len(lines) == 1 + 3
    # the program was killed while it wrote the third line
    kept.write_bytes(b"".join(lines[:3]) + lines[3][:50])
    assert run_dic("gauges", measured, *GAUGES, "-o", *again).status == 0
    assert count[0] == 4 + IMAGES - 2
    assert not kept.exists()
    for one, other in zip(sorted(tmp_path.glob("a.*")), sorted(tmp_path.glob("b.*")), strict=True):
        assert one.read_bytes() == other.read_bytes(), other.name


def test_readings_of_other_gauges_are_not_used(measured, tmp_path, monkeypatch):
    kept, table = tmp_path / ".a.csv.readings.partial", tmp_path / "a.csv"
    kept.write_text(json.dumps({"gauges": "others"}) + '\n{"label": "not of this series"}\n')
    assert run_dic("gauges", measured, *GAUGES, "-o", table).status == 0
    assert "not of this series" not in table.read_text()
    assert not kept.exists()


def test_a_command_without_results_leaves_nothing_behind(tmp_path):
    assert run_dic("gauges", tmp_path / "none.h5", *GAUGES, "-o", tmp_path / "a.csv").status == 2
    assert list(tmp_path.iterdir()) == []
