"""Correlation: displacements between a reference and deformed images."""
