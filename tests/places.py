"""Paths of folders in the checkout, and examples of the documentation with changed values."""

from pathlib import Path

ROOT = Path(__file__).parents[1]
EXAMPLES = ROOT / "examples"
DOCS = ROOT / "docs"
SHARED_DATA = ROOT.parent / "shared" / "data"

NO_STILL = "\n[images]\nstill = 0\n"


def example(name: str, *edits: tuple[str, str]) -> str:
    """Return the text of an example file with edits; the text to be replaced by each edit must exist.

    A protocol leaves out the still images, which only tests of still images need.
    """
    text = (EXAMPLES / f"{name}.toml").read_text()
    if text.startswith("kind") or '\nkind = "' in text:
        text = text.replace("[images]\n", "[images]\nstill = 0\n") if "[images]" in text else text + NO_STILL
    for old, new in edits:
        assert old in text
        text = text.replace(old, new)
    return text


def small_cameras(side_px: int, focal_px: float) -> tuple[str, str]:
    """Return the edit of a rig file that gives its simulated cameras square images of this size."""
    driver = 'driver = "simulated-camera"\n'
    settings = f"width_px = {side_px}\nheight_px = {side_px}\nfocal_px = {focal_px}\n"
    return driver, driver + settings
