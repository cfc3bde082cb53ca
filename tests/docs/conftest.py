import shutil

import pytest

from tests.places import EXAMPLES


@pytest.fixture
def beside_the_examples(tmp_path, monkeypatch):
    """Work in a folder that holds the examples, as the pages' readers do."""
    shutil.copytree(EXAMPLES, tmp_path / "examples")
    monkeypatch.chdir(tmp_path)
