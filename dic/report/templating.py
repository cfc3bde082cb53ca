"""Loads the jinja2 templates of the report's pages."""

from typing import Any


def page_templates() -> Any:
    """Return jinja2's environment for the report's templates; an unknown name in a template is an error."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    return Environment(
        loader=PackageLoader("dic.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
