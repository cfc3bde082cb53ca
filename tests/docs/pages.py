"""What stands in the pages: links, and the commands that a reader would type."""

import re
import shlex
from pathlib import Path

from tests.places import DOCS, ROOT

PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", ROOT / "CHANGELOG.md", *sorted(DOCS.rglob("*.md"))]
PAGES = [page for page in PAGES if "_build" not in page.parts]


def name(page: Path) -> str:
    """The page's path from the root of the checkout."""
    return str(page.relative_to(ROOT))


def commands(page: Path) -> list[list[str]]:
    """The `dic` and `rig` commands of a page's indented and console blocks, split as a shell would.

    What explains a command, after `#` or in a column of its own, is left out.
    """
    lines = re.findall(r"^(?:    |\$ )((?:dic|rig) \S.*)$", page.read_text(encoding="utf-8"), re.MULTILINE)
    return [shlex.split(re.split(r"\s{4,}", line)[0], comments=True) for line in lines]


def links(page: Path) -> list[str]:
    """The targets of a page's links and pictures within the project, without their anchors."""
    text = re.sub(r"```.*?```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    targets = re.findall(r"\]\(([^)\s]+)\)", text)
    return [target.split("#")[0] for target in targets if not target.startswith(("http", "#"))]


PACKAGES = "dic|drivers|rig|simulators|tests|benchmarks"


def paths(page: Path) -> list[str]:
    """The files and folders of the project that a page names, in backquotes; some with a star."""
    return re.findall(rf"`((?:{PACKAGES}|docs|examples)/[\w./*-]*)`", page.read_text(encoding="utf-8"))


def dotted_names(page: Path) -> list[str]:
    """The modules, classes and functions of the packages that a page names, in backquotes."""
    names = re.findall(rf"`((?:{PACKAGES})(?:\.\w+)+)`", page.read_text(encoding="utf-8"))
    return [name for name in names if not name.endswith((".toml", ".h5"))]
