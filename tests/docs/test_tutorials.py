"""The commands of the tutorials are executed one after the other, and print the shown output."""

import re

import pytest

from tests.command_line import run_dic, run_rig
from tests.docs.pages import commands
from tests.places import DOCS

RUN = {"dic": run_dic, "rig": run_rig}


def follow(name: str) -> None:
    """Run every command of a tutorial, and compare the printed text with the text in the page.

    Every word in the page must be printed. Every number in the page must be printed with a difference of at
    most 1 % or 2 units, because the last digits can depend on the processor.
    """
    page = (DOCS / "tutorial" / f"{name}.md").read_text(encoding="utf-8")
    blocks = re.findall(r"^```console\n(?:.*\n)*?```\n(?:\n((?:    .*\n)+))?", page, re.MULTILINE)
    printed = ""
    for program, *arguments in commands(DOCS / "tutorial" / f"{name}.md"):
        done = RUN[program](*arguments)
        assert done.status == 0, done
        printed += done.out
    shown = "\n".join(blocks)
    assert set(words(shown)) - set(words(printed)) == set()
    made = numbers(printed)
    assert [n for n in numbers(shown) if not any(abs(n - m) <= max(2.0, 0.01 * abs(n)) for m in made)] == []


def words(text: str) -> list[str]:
    """Return the words of a text."""
    return re.findall(r"\b[a-zA-Zµε%]{2,}\b", text)


def numbers(text: str) -> list[float]:
    """Return the numbers in a text."""
    return [float(number) for number in re.findall(r"-?\b\d+(?:\.\d+)?", text)]


pytestmark = pytest.mark.usefixtures("beside_the_examples")


@pytest.mark.long
def test_first_images(tmp_path):
    follow("first-images")
    for made in ("cal.h5", "grid-found.png", "points/loaded.csv", "maps/loaded.png"):
        assert (tmp_path / made).is_file()


@pytest.mark.long
def test_first_run(tmp_path):
    follow("first-run")
    for made in ("run.h5", "run.results.h5", "report.html"):
        assert (tmp_path / made).is_file()
