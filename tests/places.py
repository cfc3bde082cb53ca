"""Where tests find what is not their own."""

from pathlib import Path

ROOT = Path(__file__).parents[1]
EXAMPLES = ROOT / "examples"
DOCS = ROOT / "docs"
SHARED_DATA = ROOT.parent / "shared" / "data"
