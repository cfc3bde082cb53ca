"""Where tests find what is not their own, and examples of the documentation with other values in them."""

from pathlib import Path

ROOT = Path(__file__).parents[1]
EXAMPLES = ROOT / "examples"
DOCS = ROOT / "docs"
SHARED_DATA = ROOT.parent / "shared" / "data"


def example(name: str, *edits: tuple[str, str]) -> str:
    """Return the text of an example with edits, each of which must find what it replaces."""
    text = (EXAMPLES / f"{name}.toml").read_text()
    for old, new in edits:
        assert old in text
        text = text.replace(old, new)
    return text
