"""Compute strain from displacements, with standard deviations of the strain."""
