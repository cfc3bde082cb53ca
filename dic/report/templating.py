"""The templates of the report's pages."""

from typing import Any


def page_templates() -> Any:
    """Return jinja2's environment for the templates of the report; an unknown name is an error."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    return Environment(
        loader=PackageLoader("dic.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
