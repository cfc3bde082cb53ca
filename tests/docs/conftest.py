import shutil

import pytest

from tests.places import EXAMPLES


@pytest.fixture
def beside_the_examples(tmp_path, monkeypatch):
    """Change to a folder that contains a copy of the folder `examples`."""
    shutil.copytree(EXAMPLES, tmp_path / "examples")
    monkeypatch.chdir(tmp_path)
