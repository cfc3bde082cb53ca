"""The documentation site is built, and a warning is an error: a dead link, a page that nothing leads to."""

import subprocess
import sys

import pytest

from tests.places import DOCS

pytest.importorskip("sphinx", reason="needs the group docs: pip install offaxis[docs]")


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    folder = tmp_path_factory.mktemp("site")
    build = ["-m", "sphinx", "-W", "--keep-going", "-q", "-b", "html", "-d", str(folder / "doctrees")]
    done = subprocess.run(
        [sys.executable, *build, str(DOCS), str(folder / "html")], capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    return folder / "html"


def test_reference_knows_every_command(site):
    page = (site / "reference" / "command-line.html").read_text(encoding="utf-8")
    for command in ("dic-calibrate", "dic-correlate", "dic-process", "rig-plan", "rig-run", "rig-simulate"):
        assert f'id="{command}"' in page
