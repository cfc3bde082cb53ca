"""Corrections for the false strain of a specimen that left the grid's plane."""
