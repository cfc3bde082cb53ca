"""Writes a page on which a person draws regions, cracks and gauges over an image, offline in any browser."""
