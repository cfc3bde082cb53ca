"""Exports: writes the fields of results in the formats of other programs, image by image."""
