"""The documentation site: `make docs` builds it with Sphinx, and a warning is an error."""

import json
from importlib.metadata import version as installed_version
from typing import Any

from docutils.nodes import document
from myst_parser.parsers.sphinx_ import MystParser
from sphinx.application import Sphinx

project = "offaxis"
author = "offaxis maintainers"
project_copyright = "2026, offaxis maintainers"
version = release = installed_version("offaxis")

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx_click",
]
exclude_patterns = ["_build"]

myst_enable_extensions = ["colon_fence", "deflist"]
myst_heading_anchors = 3
# What is indented in a page is a command, a file or a drawing as often as it is Python.
highlight_language = "none"
# Single backquotes in docstrings are code, as in the Markdown pages.
default_role = "literal"

napoleon_google_docstring = False
napoleon_use_ivar = True
autodoc_member_order = "groupwise"
# Docstrings say types with shapes and units.
autodoc_typehints = "none"
autodoc_preserve_defaults = True

html_theme = "furo"
html_title = f"offaxis {version}"
html_copy_source = False


class NotebookParser(MystParser):
    """Reads a notebook as a page: Markdown cells as they are, code cells as Python.

    Notebooks are kept without output, so that nothing but these two kinds has to be shown.
    """

    supported = ("notebook",)

    def parse(self, inputstring: str, document: document) -> None:
        """Parse the notebook's cells as one Markdown page."""
        cells: list[dict[str, Any]] = json.loads(inputstring)["cells"]
        super().parse("\n\n".join(_as_markdown(cell) for cell in cells), document)


def _as_markdown(cell: dict[str, Any]) -> str:
    text = "".join(cell["source"])
    return text if cell["cell_type"] == "markdown" else f"```python\n{text}\n```"


def setup(app: Sphinx) -> None:
    """Teach Sphinx to read notebooks."""
    app.add_source_suffix(".ipynb", "notebook")
    app.add_source_parser(NotebookParser)
