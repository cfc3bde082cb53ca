"""Writes the displacement and strain fields of results in the formats of other programs, image by image."""
