"""Correlation of images: displacements between a reference image and deformed images."""
