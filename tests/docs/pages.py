"""Read the documentation pages: links, commands, and names of files and Python objects."""

import re
import shlex
from pathlib import Path

from tests.places import DOCS, ROOT

PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", ROOT / "CHANGELOG.md", *sorted(DOCS.rglob("*.md"))]
PAGES = [page for page in PAGES if "_build" not in page.parts]


def name(page: Path) -> str:
    """Return the page's path relative to the root of the checkout."""
    return str(page.relative_to(ROOT))


def commands(page: Path) -> list[list[str]]:
    """Return the `dic` and `rig` commands in a page's code blocks, split into words as by a shell.

    Explanations after `#` or in a second column are left out.
    """
    lines = re.findall(r"^(?:    |\$ )((?:dic|rig) \S.*)$", page.read_text(encoding="utf-8"), re.MULTILINE)
    return [shlex.split(re.split(r"\s{4,}", line)[0], comments=True) for line in lines]


def links(page: Path) -> list[str]:
    """Return the targets of a page's links and pictures within the project, without anchors."""
    text = re.sub(r"```.*?```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    targets = re.findall(r"\]\(([^)\s]+)\)", text)
    return [target.split("#")[0] for target in targets if not target.startswith(("http", "#"))]


PACKAGES = "dic|drivers|rig|simulators|tests|benchmarks"


def paths(page: Path) -> list[str]:
    """Return the files and folders of the project that a page names in backquotes, some with a wildcard."""
    return re.findall(rf"`((?:{PACKAGES}|docs|examples)/[\w./*-]*)`", page.read_text(encoding="utf-8"))


def dotted_names(page: Path) -> list[str]:
    """Return the modules, classes and functions of the project that a page names in backquotes."""
    names = re.findall(rf"`((?:{PACKAGES})(?:\.\w+)+)`", page.read_text(encoding="utf-8"))
    return [name for name in names if not name.endswith((".toml", ".h5"))]
