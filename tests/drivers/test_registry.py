"""Drivers of other packages are found by their names, or refused with a message of one sentence."""

import sys
from pathlib import Path

import pytest

from drivers.registry import driver_names, find_driver

GOOD = """
from drivers.registry import DriverSpec
from drivers.settings import Settings

SPEC = DriverSpec("stage", Settings, lambda settings, context: None)
"""


@pytest.fixture
def install(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(str(tmp_path))

    def package(name: str, driver: str, text: str, attribute: str = "SPEC") -> None:
        Path(tmp_path, f"{name}.py").write_text(text)
        info = tmp_path / f"{name}-1.0.dist-info"
        info.mkdir()
        (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
        (info / "entry_points.txt").write_text(f"[offaxis.drivers]\n{driver} = {name}:{attribute}\n")
        monkeypatch.delitem(sys.modules, name, raising=False)

    return package


def test_another_packages_driver_is_found(install):
    install("their_stage", "their-stage", GOOD)
    assert "their-stage" in driver_names()
    assert find_driver("their-stage").kind == "stage"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("raise RuntimeError('no library')", "cannot be loaded: RuntimeError: no library"),
        ("import nothing_of_this_name", "cannot be loaded: ModuleNotFoundError: No module named"),
        ("def (", "cannot be loaded: SyntaxError"),
        ("", "cannot be loaded: AttributeError"),
        ("SPEC = 3", "is not a DriverSpec"),
    ],
)
def test_a_driver_that_does_not_load_is_said_with_its_reason(install, text, said):
    install("bad_stage", "bad-stage", text)
    with pytest.raises(LookupError, match=said) as refused:
        find_driver("bad-stage")
    assert "bad_stage:SPEC" in str(refused.value)


def test_a_name_that_two_packages_offer_is_refused(install):
    install("false_zaber", "zaber-ascii", GOOD)
    with pytest.raises(LookupError, match=r"offered more than once: .*false_zaber:SPEC"):
        find_driver("zaber-ascii")


def test_a_name_that_nobody_offers_is_refused_with_those_there_are():
    with pytest.raises(LookupError, match=r"no driver 'zabre' is installed; there are .*zaber-ascii"):
        find_driver("zabre")
    with pytest.raises(LookupError) as refused:
        find_driver("x" * 70_000)
    assert len(str(refused.value)) < 500
