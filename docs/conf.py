"""The documentation site: `make docs` builds it with Sphinx, and a warning is an error."""

import inspect
import json
from importlib import import_module
from importlib.metadata import version as installed_version
from types import ModuleType
from typing import Any

from docutils.nodes import Node, document
from docutils.parsers.rst import directives
from myst_parser.parsers.sphinx_ import MystParser
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

project = "offaxis"
author = "offaxis maintainers"
project_copyright = "2026, offaxis maintainers"
version = release = installed_version("offaxis")

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx_click",
    "sphinx_design",
]
exclude_patterns = ["_build"]

myst_enable_extensions = ["colon_fence", "deflist"]
myst_heading_anchors = 3
# An indented block of a page may be a command, a file, a drawing or Python.
highlight_language = "none"
# Single backquotes in docstrings are code, as in the Markdown pages.
default_role = "literal"

napoleon_google_docstring = False
napoleon_custom_sections = [("Attributes", "params_style")]
# In the docstrings a type is a phrase, such as "ndarray, shape (rows, columns)", and not a list of names.
napoleon_use_param = False
napoleon_use_rtype = False
# The docstrings give types with shapes and units.
autodoc_typehints = "none"
autodoc_default_options = {"exclude-members": "model_config"}
autodoc_preserve_defaults = True

html_theme = "furo"
html_title = f"offaxis {version}"
html_copy_source = False


class PublicNames(SphinxDirective):
    """Describes the functions, classes or errors that a package and those below it list in `__all__`.

    No name is listed by hand, so a new public name is described automatically.
    """

    required_arguments = 1
    option_spec = {"kind": directives.unchanged_required}  # noqa: RUF012

    def run(self) -> list[Node]:
        """Return the descriptions, in alphabetical order."""
        package = self.arguments[0]
        lines = ["```{eval-rst}"]
        for name, value in _public(import_module(package)).items():
            if _kind(value) == self.options["kind"]:
                lines += [f".. auto{self.options['kind']}:: {name}"]
                lines += ["   :members:"] if self.options["kind"] == "class" else []
                # An object of another package is indexed on that package's page, and only shown here.
                lines += [] if value.__module__.startswith(package) else ["   :no-index:"]
                lines += [""]
        return self.parse_text_to_nodes("\n".join([*lines, "```"]))


def _public(module: ModuleType) -> dict[str, Any]:
    """Return what a package lists, by its full name, and then what only the packages below it list."""
    listed = {name: getattr(module, name) for name in sorted(module.__all__, key=str.lower)}
    packages = {name: value for name, value in listed.items() if inspect.ismodule(value)}
    found = {f"{module.__name__}.{name}": value for name, value in listed.items() if name not in packages}
    for below in packages.values():
        found |= {name: value for name, value in _public(below).items() if name.split(".")[-1] not in listed}
    return found


def _kind(value: object) -> str:
    if inspect.isclass(value):
        return "exception" if issubclass(value, Exception) else "class"
    return "function" if inspect.isroutine(value) else "data"


class NotebookParser(MystParser):
    """Reads a notebook as a page: Markdown cells unchanged, code cells as Python.

    The notebooks are stored without output, so only these two kinds of cells are shown.
    """

    supported = ("notebook",)

    def parse(self, inputstring: str, document: document) -> None:
        """Parse the notebook's cells as one Markdown page."""
        cells: list[dict[str, Any]] = json.loads(inputstring)["cells"]
        super().parse("\n\n".join(_as_markdown(cell) for cell in cells), document)


def _as_markdown(cell: dict[str, Any]) -> str:
    text = "".join(cell["source"])
    return text if cell["cell_type"] == "markdown" else f"```python\n{text}\n```"


def _signature(app: Sphinx, what: str, name: str, value: object, *_: object) -> tuple[str, str] | None:
    """Remove the arguments of an interface's signature, because nobody calls an interface."""
    return ("", "") if getattr(value, "_is_protocol", False) else None


def setup(app: Sphinx) -> None:
    """Make Sphinx read notebooks and list public names."""
    app.connect("autodoc-process-signature", _signature)
    app.add_directive("public", PublicNames)
    app.add_source_suffix(".ipynb", "notebook")
    app.add_source_parser(NotebookParser)
